"""Write executed paths as joint trajectories: json, and trajectory_msgs/JointTrajectory in a ROS 2 bag."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from rosbags.rosbag2 import StoragePlugin, Writer  # pyright: ignore[reportMissingImports]
from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

KIND = "trajectory_msgs/msg/JointTrajectory"
TYPES = get_typestore(Stores.ROS2_HUMBLE)
SECOND = 1_000_000_000  # nanoseconds


def trajectory(joints: Sequence[str], q: Float[Array, "instant joint"], duration_s: float) -> dict[str, Any]:
    """Return a movement as in JointTrajectory: names, and positions [rad] and speeds [rad/s] at times [s]."""
    t = np.linspace(0.0, duration_s, len(q))
    speeds = np.gradient(q, t, axis=0)
    speeds[[0, -1]] = 0.0  # the arm rests before and after
    points = [
        {"time_from_start": float(at), "positions": one.tolist(), "velocities": speed.tolist()}
        for at, one, speed in zip(t, q, speeds, strict=True)
    ]
    return {"joint_names": list(joints), "points": points}


def write_bag(folder: Path, trajectories: Mapping[str, Mapping[str, Any]], frame: str) -> None:
    """Write each trajectory as one message on a topic of its name; one second lies between messages."""
    types = TYPES.types
    with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as bag:
        for second, (name, one) in enumerate(trajectories.items()):
            stamp = types["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
            points: Any = [
                types["trajectory_msgs/msg/JointTrajectoryPoint"](
                    positions=np.array(point["positions"]),
                    velocities=np.array(point["velocities"]),
                    accelerations=np.zeros(0),
                    effort=np.zeros(0),
                    time_from_start=_duration(point["time_from_start"]),
                )
                for point in one["points"]
            ]
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame)
            message = types[KIND](header=header, joint_names=list(one["joint_names"]), points=points)
            connection = bag.add_connection(f"/{name}", KIND, typestore=TYPES)
            bag.write(connection, second * SECOND, TYPES.serialize_cdr(message, KIND))


def _duration(seconds: float) -> Any:
    """Return a ROS duration."""
    whole, rest = divmod(round(seconds * SECOND), SECOND)
    return TYPES.types["builtin_interfaces/msg/Duration"](sec=whole, nanosec=rest)
