"""Bags for tests, written by rosbags' own writer."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer  # pyright: ignore[reportMissingImports]
from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

STORE = get_typestore(Stores.ROS2_HUMBLE)
STORAGES = [StoragePlugin.SQLITE3, StoragePlugin.MCAP]
START_NS = 1_700_000_000 * 10**9
Entry = tuple[float, str, Any]  # seconds, topic, message


def make(name: str, *values: Any, **more: Any) -> Any:
    """A message by its short name, such as `geometry_msgs/Point`."""
    return STORE.types[name.replace("/", "/msg/")](*values, **more)


def stamp(t: float) -> Any:
    return make("builtin_interfaces/Time", *divmod(START_NS + round(t * 1e9), 10**9))


def header(t: float, frame: str) -> Any:
    return make("std_msgs/Header", stamp(t), frame)


def pose(x: float, y: float, turn: float = 0) -> Any:
    """At x, y, turned counter-clockwise [radians]."""
    turned = make("geometry_msgs/Quaternion", 0.0, 0.0, np.sin(turn / 2), np.cos(turn / 2))
    return make("geometry_msgs/Pose", make("geometry_msgs/Point", x, y, 0.1), turned)


def posed(t: float, x: float, y: float, frame: str = "table") -> Any:
    return make("geometry_msgs/PoseStamped", header(t, frame), pose(x, y))


def odometry(t: float, x: float, y: float) -> Any:
    zero = make("geometry_msgs/Vector3", 0.0, 0.0, 0.0)
    twist = make("geometry_msgs/TwistWithCovariance", make("geometry_msgs/Twist", zero, zero), np.zeros(36))
    posed = make("geometry_msgs/PoseWithCovariance", pose(x, y), np.zeros(36))
    return make("nav_msgs/Odometry", header(t, "table"), "hand", posed, twist)


def tf(t: float, parent: str, child: str, x: float, y: float, turn: float = 0) -> Any:
    at = pose(x, y, turn)
    shift = make("geometry_msgs/Vector3", at.position.x, at.position.y, 0.0)
    transform = make("geometry_msgs/Transform", shift, at.orientation)
    return make("tf2_msgs/TFMessage", [make("geometry_msgs/TransformStamped", header(t, parent), child, transform)])


def image(t: float, pixels: np.ndarray, encoding: str) -> Any:
    """Of RGB pixels, in an encoding of sensor_msgs/Image with four bytes of padding a row, or compressed."""
    bgr = pixels[..., ::-1]
    if encoding in ("jpeg", "png"):
        data = cv2.imencode(f".{encoding}", bgr)[1].ravel()
        return make("sensor_msgs/CompressedImage", header(t, "camera"), encoding, data)
    alpha = np.full((*pixels.shape[:2], 1), 255, np.uint8)
    odd = np.indices(pixels.shape[:2]) % 2  # of row and column
    kinds = {"rgb8": pixels, "bgr8": bgr, "rgba8": np.concatenate([pixels, alpha], -1), "mono8": pixels[..., :1]}
    kinds |= {"8UC3": bgr, "bayer_grbg8": np.take_along_axis(pixels, (1 - odd[1] + odd[0])[..., None], -1)}
    rows = np.pad(kinds.get(encoding, pixels).reshape(len(pixels), -1), ((0, 0), (0, 4)))
    return make("sensor_msgs/Image", header(t, "camera"), *pixels.shape[:2], encoding, 0, rows.shape[1], rows.ravel())


def write(path: Path, entries: Iterable[Entry], storage: StoragePlugin = StoragePlugin.MCAP, **compressed: Any) -> Path:
    writer = Writer(path, version=9, storage_plugin=storage)
    if compressed:
        writer.set_compression(**compressed)
    with writer:
        connections: dict[str, Any] = {}
        for t, topic, message in sorted(entries, key=lambda entry: entry[0]):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], START_NS + round(t * 1e9), STORE.serialize_cdr(message, kind))
    return path
