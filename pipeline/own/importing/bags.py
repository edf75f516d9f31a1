"""Read ROS bags message by message: poses, TF, a gripper, and a picture for each demonstration."""

from array import array
from collections import deque
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from rosbags.highlevel import AnyReader  # pyright: ignore[reportMissingImports]
from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]
from scipy.spatial.transform import Rotation

from pipeline.own.importing.segments import SPANS_M, Choices, Recording
from pipeline.runtime.errors import InputError
from pipeline.world.images import JPEG_SIGNATURE, PNG_SIGNATURE

PATH, TF = "nav_msgs/msg/Path", "tf2_msgs/msg/TFMessage"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped", "nav_msgs/msg/Odometry", PATH)
PICTURES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
BAYER = {f"bayer_{c}8": getattr(cv2, f"COLOR_Bayer{c.upper()}2BGR") for c in ("rggb", "bggr", "gbrg", "grbg")}
CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1, "8UC3": 3, "8UC1": 1, **dict.fromkeys(BAYER, 1)}
TO_BGR = {"rgb8": cv2.COLOR_RGB2BGR, "rgba8": cv2.COLOR_RGBA2BGR, "bgra8": cv2.COLOR_BGRA2BGR, **BAYER}
BEFORE_NS = [10**9, 10**10, 10**11, 2**62]  # how far back a demonstration's picture is looked for, step by step
LATE_NS = 10**9  # how much later than its demonstration a picture may be: a camera that started after the robot
ORIGIN = SimpleNamespace(x=0.0, y=0.0, z=0.0)  # of a frame that moves
PLAN_STEP_S = 0.1  # assumed between the poses of a nav_msgs/Path without times
Parents = dict[str, tuple[str, Float[Array, "4 4"]]]  # of TF frames: the parent's name, the transform to it


def read(path: Path, choices: Choices) -> tuple[list[Recording], Choices, list[str]]:
    """Return a bag's recordings, the choices with what was found, and remarks; InputError for an unusable bag."""
    hand, table = ((name or "").lstrip("/") for name in (choices.hand, choices.frame))
    parents, frames, held, lost, count = Parents(), set[str](), np.nan, 0, 0
    tracks = list[array]()  # t [s], x, y, gripper, when the bag received it [ns], t ... of each recording
    said = list[tuple[int, str]]()  # labels, with when the bag received them [ns]
    with opened(path) as bag:
        transforms = [c for c in bag.connections if c.msgtype == TF and (hand or table)]
        fixed = [c for c in transforms if not table or c.topic.endswith("tf_static")]  # hold from the beginning
        for _, _, raw in bag.messages(fixed) if fixed else ():
            update(parents, bag.deserialize(raw, TF))
        if hand and not table:
            raise InputError(f"--hand needs the table's frame: add --frame; TF holds {_known(parents)}")
        poses = [] if hand else choose(bag, choices.topic, "--topic", POSES)
        if not poses and not hand:
            listed = ", ".join(f"{c.topic} ({c.msgtype})" for c in bag.connections) or "nothing"
            raise InputError(f"{path} holds {listed}: expected {', '.join(POSES)}, or TF by --hand and --frame")
        gripper, _, joint = (choices.gripper or "").partition(":")
        grippers = choose(bag, gripper, "--gripper") if gripper else []
        labels = choose(bag, choices.label, "--label") if choices.label else []
        cameras = choose(bag, choices.picture, "--picture", PICTURES)
        tf = [c for c in transforms if c not in fixed]
        for connection, logged, raw in bag.messages([*poses, *grippers, *labels, *tf]):
            message, samples = bag.deserialize(raw, connection.msgtype), []
            if connection in tf:
                update(parents, message)
                samples = [(logged * 1e-9, hand, ORIGIN)] if hand else []
            elif connection in grippers:
                held = _value(message, joint, held)
            elif connection in labels:
                said.append((logged, str(getattr(message, "data", connection.msgtype))))
            elif connection.msgtype == PATH:
                samples = [(_seconds(p.header.stamp), p.header.frame_id, p.pose.position) for p in message.poses]
                tracks.append(array("d"))
            else:
                pose = message.pose if hasattr(message.pose, "position") else message.pose.pose
                samples = [(_seconds(message.header.stamp) or logged * 1e-9, message.header.frame_id, pose.position)]
            count += connection in poses
            for t, frame, position in samples:
                frames.add(frame := (frame or message.header.frame_id).lstrip("/"))
                xyz = np.array([position.x, position.y, position.z, 1.0])
                if table and frame != table:
                    matrix = between(parents, frame, table)
                    xyz = matrix @ xyz if matrix is not None else np.full(4, np.nan)
                tracks = tracks or [array("d")]
                tracks[-1].extend((t, xyz[0], xyz[1], held, logged) if np.isfinite(xyz).all() else ())
                lost += not np.isfinite(xyz).all()
            if len(tracks) > 1 and tracks[-2][:3] == tracks[-1][:3]:
                del tracks[-2]  # a path that was published again as it grew
    if count < sum(c.msgcount for c in poses):
        why = "it is truncated, or its metadata.yaml is another bag's: copy it again, or name its .db3 or .mcap file"
        raise InputError(f"{path} ends after {count} poses, its index names more: {why}")
    if not any(tracks):
        missing = f"no transform from {', '.join(frames) or hand} to {table}: TF holds {_known(parents)}"
        bare = f"{path} has {lost} poses in {''.join(c.topic for c in poses[:1])}, none with numbers: choose by --topic"
        raise InputError(missing if table else bare)
    if not table and len(frames) > 1:
        raise InputError(f"the poses are in the frames {', '.join(sorted(frames))}: choose the table's by --frame")
    why = f", or before the first transform to {table}" if table else ""
    notes = [f"{lost} poses were left out: no numbers{why}"] if lost else []
    topic, picture = (connections[0].topic if connections else None for connections in (poses, cameras))
    parts = [np.array(track).reshape(-1, 5) for track in tracks if track]
    widest = max(float(np.ptp(samples[:, 1:3], axis=0).max()) for samples in parts)
    unit = choices.unit or ("m" if widest <= SPANS_M[1] else None)  # as ROS prescribes; others publish millimetres
    found = {"topic": topic, "picture": picture, "frame": choices.frame or next(iter(frames)), "unit": unit}
    choices, recordings, whole = choices.model_copy(update=found), [], bool(topic) and poses[0].msgtype == PATH
    for samples, after in zip(parts, [*parts[1:], np.full((1, 5), np.inf)], strict=True):
        if whole and not np.ptp(samples[:, 0]):
            samples[:, 0] = np.arange(len(samples)) * PLAN_STEP_S
            notes.append(f"a path has no times: {PLAN_STEP_S} s between its poses is assumed")
        heard = [(t, word) for t, word in said if samples[0, 4] <= t < after[0, 4]]
        words = [(int(np.searchsorted(samples[:, 4], t)), word) for t, word in heard]
        t, gripper = samples[:, 0] - samples[0, 0], samples[:, 3] if choices.gripper else None
        pictures = partial(_pictures, path, choices, samples[:, 4])
        recordings.append(Recording(path.resolve().stem, t, samples[:, 1:3], gripper, words, whole, {}, pictures))
    return recordings, choices, notes


def opened(path: Path) -> Any:
    """Return a bag to open; messages of bags that hold no definitions are those of ROS 2 Humble."""
    for file in path.glob("*.db3") if path.is_dir() else [path] * (path.suffix == ".db3"):
        with file.open("rb") as stream:
            header = stream.read(100)  # of SQLite, which reads what a lost end held as zeros
        page = int.from_bytes(header[16:18])  # [bytes]; 1 is 65536
        expected = (2**16 if page == 1 else page) * int.from_bytes(header[28:32])
        if file.stat().st_size < expected and header[24:28] == header[92:96]:
            raise InputError(f"{file} is truncated, {file.stat().st_size} of {expected} bytes: copy it again")
    return AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE))


def choose(bag: Any, topic: str | None, option: str, types: Sequence[str] = ()) -> list[Any]:
    """Return the connections of a topic, or of the only one of these types; [] if there is none.

    Raise InputError, which lists the candidates, if the topic is not among them or there are several.
    """
    known = {c.topic: c for c in bag.connections if not types or c.msgtype in types}
    if (topic or next(iter(known), None)) not in (None, *known) or (topic is None and len(known) > 1):
        listed = ", ".join(f"{name} ({c.msgtype}, {c.msgcount} messages)" for name, c in known.items())
        what = f"{topic} is not among" if topic else "several may be meant of"
        kind = f" of {', '.join(types)}" if types else ""
        wrong = f"{what} {listed}: choose one" if listed else f"there is no topic{kind}: leave it out"
        raise InputError(f"{bag.paths[0]}: {option}: {wrong}")
    return [c for c in bag.connections if c.topic in ([topic] if topic else known)]


def update(parents: Parents, message: Any) -> None:
    """Take the transforms of a TFMessage."""
    for one in message.transforms:
        turn, shift, matrix = one.transform.rotation, one.transform.translation, np.eye(4)
        child, parent = one.child_frame_id.lstrip("/"), one.header.frame_id.lstrip("/")
        if not np.linalg.norm(quaternion := [turn.x, turn.y, turn.z, turn.w]) > 0:
            what = f"the transform from {child} to {parent} has the rotation {quaternion}"
            raise InputError(f"{what}: expected a unit quaternion, such as [0, 0, 0, 1]; correct what publishes it")
        matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
        matrix[:3, 3] = shift.x, shift.y, shift.z
        parents[child] = parent, matrix


def _known(parents: Parents) -> str:
    """Return the names of all frames."""
    return ", ".join(sorted({*parents, *(parent for parent, _ in parents.values())})) or "no frame"


def between(parents: Parents, source: str, target: str) -> Float[Array, "4 4"] | None:
    """Return the newest transform from one frame to another, or None if they do not hang together."""
    ups, downs = ({frame: np.eye(4)} for frame in (source, target))  # to the frame itself and its ancestors
    for frame, matrices in ((source, ups), (target, downs)):
        while frame in parents and parents[frame][0] not in matrices:
            parent, matrix = parents[frame]
            matrices[parent] = matrix @ matrices[frame]
            frame = parent
    common = next((frame for frame in ups if frame in downs), None)
    return None if common is None else np.linalg.inv(downs[common]) @ ups[common]


def _pictures(path: Path, choices: Choices, logged: Float[Array, " n"], rows: Sequence[int]) -> Iterator[bytes | None]:
    with opened(path) as bag:
        cameras = choose(bag, choices.picture, "--picture", PICTURES)
        yield from (_picture(bag, cameras, int(logged[row])) if cameras else None for row in rows)


def _seconds(stamp: Any) -> float:
    return stamp.sec + stamp.nanosec * 1e-9


def _value(message: Any, joint: str, held: float) -> float:
    """Return what a gripper's message says: `data` of std_msgs, or `position`, of a joint by name; else `held`."""
    names = list(getattr(message, "name", ()))
    if joint and names:  # other messages of the topic may name other joints
        return float(message.position[names.index(joint)]) if joint in names else held
    value: Any = getattr(message, "data", getattr(message, "position", None))
    if joint or not isinstance(value, bool | int | float):
        listed = ", ".join(names) or "no joints"
        raise InputError(f"--gripper: its messages have {listed}: expected a number, or TOPIC:JOINT")
    return float(value)


def _picture(bag: Any, cameras: Sequence[Any], logged: int) -> bytes | None:
    """Return the newest picture before a time [ns], or the first one soon after it, as png or jpeg."""
    spans = (bag.messages(cameras, max(logged - before, 0), logged) for before in BEFORE_NS)
    found = next((newest[0] for span in spans if (newest := deque(span, maxlen=1))), None)
    found = found or next(bag.messages(cameras, logged, logged + LATE_NS), None)
    if found is None:
        return None
    topic, message = found[0].topic, bag.deserialize(found[2], found[0].msgtype)
    if not hasattr(message, "encoding"):
        data = message.data.tobytes()
        if not data.startswith((JPEG_SIGNATURE, PNG_SIGNATURE)) or cv2.imdecode(message.data, cv2.IMREAD_COLOR) is None:
            raise InputError(f"{topic}: a picture is damaged, or {message.format!r}: expected a whole jpeg or png")
        return data
    if message.encoding not in CHANNELS:
        raise InputError(f"{topic}: its encoding is {message.encoding!r}: expected {', '.join(CHANNELS)}, or jpeg")
    size, width = f"{message.width} x {message.height}", message.width * CHANNELS[message.encoding]
    if not 0 < width <= message.step or len(message.data) != message.height * message.step:
        held = f"{len(message.data)} bytes in rows of {message.step}"
        raise InputError(f"{topic}: a picture of {size} pixels has {held}: correct what publishes it, or --picture")
    rows = message.data.reshape(message.height, message.step)[:, :width]
    pixels = np.ascontiguousarray(rows.reshape(message.height, message.width, -1))
    pixels = cv2.cvtColor(pixels, TO_BGR[message.encoding]) if message.encoding in TO_BGR else pixels
    return cv2.imencode(".png", pixels)[1].tobytes()
