"""Write executed paths as joint trajectories in a ROS 2 bag."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from rosbags.rosbag2 import StoragePlugin, Writer  # pyright: ignore[reportMissingImports]
from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

from pipeline.robot.arm import Arm

KIND = "trajectory_msgs/msg/JointTrajectory"
TYPES = get_typestore(Stores.ROS2_HUMBLE)
SECOND = 1_000_000_000  # nanoseconds


def write_bag(folder: Path, arm: Arm, moves: Mapping[str, tuple[Float[Array, "instant joint"], float]]) -> None:
    """Write each movement, joint positions [rad] and duration [s], as one message on a topic of its name.

    One second lies between messages.
    """
    types: Any = TYPES.types
    with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as bag:
        for second, (name, (q, duration_s)) in enumerate(moves.items()):
            t = np.linspace(0.0, duration_s, len(q))
            speeds = np.gradient(q, t, axis=0)
            speeds[[0, -1]] = 0.0  # the arm rests before and after
            points = [
                types["trajectory_msgs/msg/JointTrajectoryPoint"](
                    positions=positions,
                    velocities=velocities,
                    accelerations=np.zeros(0),
                    effort=np.zeros(0),
                    time_from_start=types["builtin_interfaces/msg/Duration"](*divmod(round(at * SECOND), SECOND)),
                )
                for at, positions, velocities in zip(t, q, speeds, strict=True)
            ]
            stamp = types["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=arm.model.frames[1].name)
            message = types[KIND](header=header, joint_names=list(arm.model.names[1:]), points=points)
            connection = bag.add_connection(f"/{name}", KIND, typestore=TYPES)
            bag.write(connection, second * SECOND, TYPES.serialize_cdr(message, KIND))
