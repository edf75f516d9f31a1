"""Carry out paths joint by joint: timing, joint positions at each instant, tracking error, and why a path fails.

Executed paths are exported as joint trajectories in a ROS 2 bag.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from rosbags.rosbag2 import StoragePlugin, Writer  # pyright: ignore[reportMissingImports]
from rosbags.typesys import Stores, get_typestore  # pyright: ignore[reportMissingImports]

from pipeline.robot.arm import GRIP, Arm, Bench
from pipeline.robot.inverse import FREE, POLISHING, PostureMap, Solver
from pipeline.world.bezier import P_F, P_INIT, basis, curve

ARC_POINTS = 257  # points by which a path's length is measured
Z = Float[Array, "path 2"]  # z_theta [table sides]
FAILURES = ("", "out of reach", "collision", "off the table", "joint speed", "tracking")  # "": executed
KIND = "trajectory_msgs/msg/JointTrajectory"
TYPES = get_typestore(Stores.ROS2_HUMBLE)
SECOND = 1_000_000_000  # nanoseconds


@dataclass(frozen=True)
class Motion:
    """Executed paths, in the table's frame, z above its top."""

    q: Float[Array, "path instant joint"]  # joint positions [rad]
    chain: Float[Array, "path instant place 3"]  # places [m] of the joints, and then of the grip
    grip: Float[Array, "path instant 3"]  # [m]
    heading: Float[Array, "path instant"]  # of the grip [rad]
    results: pd.DataFrame  # a row a path: duration_s, error_mean_m, error_max_m, speed_share, failure


def lengths(z_theta: Z) -> Float[Array, " path"]:
    """Return the length of each Bezier path [table sides]."""
    return np.linalg.norm(np.diff(curve(z_theta, ARC_POINTS), axis=1), axis=-1).sum(-1)


def minimum_jerk(z_theta: Z, instants: int) -> Float[Array, "path instant 2"]:
    """Return the points [table sides] of each path at evenly spaced instants of a movement with minimum jerk.

    After Flash and Hogan (1985), as the recordings are timed.
    """
    tau, at = np.linspace(0.0, 1.0, instants), np.linspace(0.0, 1.0, ARC_POINTS)
    share = tau**3 * (10 - 15 * tau + 6 * tau**2)
    steps = np.linalg.norm(np.diff(curve(z_theta, ARC_POINTS), axis=1), axis=-1)
    passed = np.concatenate([np.zeros((len(steps), 1)), steps.cumsum(1)], 1)
    t = np.stack([np.interp(share, one / one[-1], at) for one in passed])
    b = basis(t)  # (path, instant, 3)
    return b[..., :1] * P_INIT + b[..., 1:2] * z_theta[:, None] + b[..., 2:] * P_F


def execute(
    arm: Arm,
    bench: Bench,
    postures: PostureMap,
    z_theta: Z,
    instants: int,
    speed_m_s: float,
    error_m: float,
    tilt_rad: float,
) -> Motion:
    """Carry out each Bezier path at a mean speed [m/s] of the grip, at most `error_m` off it and tilted by `tilt_rad`.

    Joint positions come from the map, within the joints' stops. Where they deviate too far from a path that the map
    reaches, they are polished by inverse kinematics at each instant. The grip's place follows from them by forward
    kinematics. speed_share: largest joint speed as a share of the joint's limit.
    """

    def off() -> Bool[Array, " path"]:
        error = np.linalg.norm(places[..., -1, :] - targets, axis=-1)
        tilt = np.arccos(np.clip(rotation[..., 2, 2], -1.0, 1.0))
        return (error.max(1) > error_m) | (tilt.max(1) > tilt_rad)

    points = minimum_jerk(z_theta, instants)
    q = np.clip(postures.postures(points), arm.model.lowerPositionLimit, arm.model.upperPositionLimit)
    targets, status = bench.to_base(points), postures.worst(points)
    places, rotation = forward(arm, q)
    again = np.flatnonzero(off() & (status == FREE))
    if len(again):
        solver, rough = Solver(arm), q[again]
        pairs = zip(rough.reshape(-1, q.shape[-1]), targets[again].reshape(-1, 3), strict=True)
        q[again] = np.stack([solver.solve(start, at, POLISHING)[0] for start, at in pairs]).reshape(rough.shape)
        places[again], rotation[again] = forward(arm, q[again])
    error = np.linalg.norm(places[..., -1, :] - targets, axis=-1)
    duration = lengths(z_theta) * bench.side_m / speed_m_s
    speed = np.abs(np.diff(q, axis=1)) * (instants - 1) / duration[:, None, None]
    share = (speed / arm.model.velocityLimit).max((1, 2))
    named = np.select([status > 0, share > 1, off()], [status, 4, 5], 0)
    results = pd.DataFrame({"duration_s": duration, "error_mean_m": error.mean(1), "error_max_m": error.max(1)})
    results = results.assign(speed_share=share, failure=np.array(FAILURES)[named])
    ahead = bench.base.rotation @ rotation[..., :, 0, None]
    chain = bench.to_table(places)
    return Motion(q, chain, chain[..., -1, :], np.arctan2(ahead[..., 1, 0], ahead[..., 0, 0]), results)


def forward(
    arm: Arm, q: Float[Array, "*instant joint"]
) -> tuple[Float[Array, "*instant place 3"], Float[Array, "*instant 3 3"]]:
    """Return the places [m] of the joints, and then of the grip, and the grip's rotation, in the base's frame."""
    model, data, grip = arm.model, arm.model.createData(), arm.model.getFrameId(GRIP)
    places, rotation = np.empty((*q.shape[:-1], model.njoints, 3)), np.empty((*q.shape[:-1], 3, 3))
    for at in np.ndindex(q.shape[:-1]):
        pin.forwardKinematics(model, data, q[at])
        pose = pin.updateFramePlacement(model, data, grip)
        places[at] = [*(data.oMi[joint].translation for joint in range(1, model.njoints)), pose.translation]
        rotation[at] = pose.rotation
    return places, rotation


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
            point, span = types["trajectory_msgs/msg/JointTrajectoryPoint"], types["builtin_interfaces/msg/Duration"]
            none = {"accelerations": np.zeros(0), "effort": np.zeros(0)}
            points = [
                point(positions=x, velocities=v, time_from_start=span(*divmod(round(at * SECOND), SECOND)), **none)
                for at, x, v in zip(t, q, speeds, strict=True)
            ]
            stamp = types["builtin_interfaces/msg/Time"](sec=second, nanosec=0)
            header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=arm.model.frames[1].name)
            message = types[KIND](header=header, joint_names=list(arm.model.names[1:]), points=points)
            connection = bag.add_connection(f"/{name}", KIND, typestore=TYPES)
            bag.write(connection, second * SECOND, TYPES.serialize_cdr(message, KIND))
