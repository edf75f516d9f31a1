"""Carry out paths joint by joint: joint positions at each instant, tracking error, and why a path fails."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.robot.arm import GRIP, Arm
from pipeline.robot.bench import Bench
from pipeline.robot.inverse import FREE, PostureMap, polished
from pipeline.robot.motion import lengths, minimum_jerk

FAILURES = ("", "out of reach", "joint limit", "collision", "off the table", "joint speed", "tracking")  # "": executed


@dataclass(frozen=True)
class Tolerances:
    """Hold how far an executed path may deviate."""

    error_m: float  # largest distance of the grip from the path
    tilt_rad: float  # largest tilt of what it carries


@dataclass(frozen=True)
class Motion:
    """Executed paths: joint positions [rad], grip [m] in the table's frame, z above its top, and heading [rad]."""

    q: Float[Array, "path instant joint"]
    grip: Float[Array, "path instant 3"]
    heading: Float[Array, "path instant"]
    results: pd.DataFrame  # a row a path: duration_s, error_mean_m, error_max_m, speed_share, failure


def execute(
    arm: Arm,
    bench: Bench,
    postures: PostureMap,
    z_theta: Float[Array, "path 2"],
    instants: int,
    speed_m_s: float,
    allowed: Tolerances,
) -> Motion:
    """Carry out each Bezier path at a mean speed [m/s] of the grip.

    Joint positions come from the map, within the joints' stops. Where they deviate too far from a path that the map
    reaches, they are polished by inverse kinematics at each instant. The grip's place follows from them by forward
    kinematics. speed_share: largest joint speed as a share of the joint's limit.
    """
    points = minimum_jerk(z_theta, instants)
    q = np.clip(postures.postures(points), arm.model.lowerPositionLimit, arm.model.upperPositionLimit)
    targets, status = bench.to_base(points), postures.worst(points)
    place, rotation, error, tilt = deviation(arm, q, targets)
    again = np.flatnonzero(_off(error, tilt, allowed) & (status == FREE))
    if len(again):
        q[again] = polished(arm, q[again], targets[again])
        place[again], rotation[again], error[again], tilt[again] = deviation(arm, q[again], targets[again])
    duration = lengths(z_theta) * bench.side_m / speed_m_s
    speed = np.abs(np.diff(q, axis=1)) * (instants - 1) / duration[:, None, None]
    share = (speed / arm.model.velocityLimit).max((1, 2))
    named = np.select([status > 0, share > 1, _off(error, tilt, allowed)], [status, 5, 6], 0)
    results = pd.DataFrame(
        {
            "duration_s": duration,
            "error_mean_m": error.mean(1),
            "error_max_m": error.max(1),
            "speed_share": share,
            "failure": np.array(FAILURES)[named],
        }
    )
    ahead = bench.base.rotation @ rotation[..., :, 0, None]
    return Motion(q, bench.to_table(place), np.arctan2(ahead[..., 1, 0], ahead[..., 0, 0]), results)


def _off(
    error: Float[Array, "path instant"], tilt: Float[Array, "path instant"], allowed: Tolerances
) -> Bool[Array, " path"]:
    return (error.max(1) > allowed.error_m) | (tilt.max(1) > allowed.tilt_rad)


def deviation(
    arm: Arm, q: Float[Array, "path instant joint"], targets: Float[Array, "path instant 3"]
) -> tuple[Array, Array, Float[Array, "path instant"], Float[Array, "path instant"]]:
    """Return the grip's place [m], its rotation, its distance from the targets [m], and its tilt [rad]."""
    place, rotation = forward(arm, q)
    error = np.linalg.norm(place - targets, axis=-1)
    return place, rotation, error, np.arccos(np.clip(rotation[..., 2, 2], -1.0, 1.0))


def forward(
    arm: Arm, q: Float[Array, "*instant joint"]
) -> tuple[Float[Array, "*instant 3"], Float[Array, "*instant 3 3"]]:
    """Return the grip's place [m] and rotation in the base's frame at joint positions [rad]."""
    model, data, frame = arm.model, arm.model.createData(), arm.model.getFrameId(GRIP)
    flat = q.reshape(-1, q.shape[-1])
    place, rotation = np.empty((len(flat), 3)), np.empty((len(flat), 3, 3))
    for i, one in enumerate(flat):
        pin.forwardKinematics(model, data, one)
        pose = pin.updateFramePlacement(model, data, frame)
        place[i], rotation[i] = pose.translation, pose.rotation
    return place.reshape(*q.shape[:-1], 3), rotation.reshape(*q.shape[:-1], 3, 3)
