"""Clearance of the gripper and of what it carries from the items on the table, in three dimensions.

Items stand on the table as upright prisms over their footprints. A carried part is an upright prism over a capsule
that reaches from its lower edge upwards, so distances between the two are exact.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.robot.arm import GRIP, Arm
from pipeline.world.layout import EMPTY, SYMBOLS, Layouts, segment_distance


@dataclass(frozen=True)
class Part:
    """A carried part: a capsule in the plane, from `back` to `front` along the grip's heading, and its lower edge."""

    back_m: float
    front_m: float
    radius_m: float
    bottom_m: float  # lower edge below the grip
    top_m: float = 0.0  # upper edge above the grip


def gripper_of(arm: Arm) -> Part:
    """Return the part around all collision shapes beyond the last joint."""
    model, data = arm.model, arm.model.createData()
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    grip = model.frames[model.getFrameId(GRIP)]
    corners: list[Array] = []
    for shape in arm.shapes.geometryObjects:
        if shape.parentJoint == grip.parentJoint:
            shape.geometry.computeLocalAABB()
            box: coal.AABB = shape.geometry.aabb_local
            all_corners = np.array(list(product(*zip(box.min_, box.max_, strict=True))))
            pose = grip.placement.inverse() * shape.placement
            corners.append(all_corners @ pose.rotation.T + pose.translation)
    (x0, y0, z0), (x1, y1, z1) = np.concatenate(corners).min(0), np.concatenate(corners).max(0)
    radius = float(max(-y0, y1))
    return Part(float(min(x0 + radius, 0)), float(max(x1 - radius, 0)), radius, float(-z0), float(z1))


def item_heights(layouts: Layouts, heights: Mapping[str, float]) -> Float[Array, "scene slot"]:
    """Return the height [m] of each item by its symbol; 0 in empty slots."""
    by_symbol = np.array([heights[symbol] for symbol in SYMBOLS] + [0.0])
    return np.where(layouts.symbol == EMPTY, 0.0, by_symbol[layouts.symbol])


def clearances(
    part: Part,
    grip: Float[Array, "path instant 3"],
    heading: Float[Array, "path instant"],
    layouts: Layouts,
    side_m: float,
    heights: Mapping[str, float],
) -> Float[Array, "path slot"]:
    """Return the least distance [m] of a part from each item along each path: negative where they overlap.

    grip [m], heading [rad]: in the table's frame, z above its top; layouts: the scene of each path, whose lengths, as
    `heights` [m], are multiplied by `side_m`. inf in empty slots.
    """
    along = np.stack([np.cos(heading), np.sin(heading)], -1)
    ends = np.stack([grip[..., :2] + part.back_m * along, grip[..., :2] + part.front_m * along], -2)
    lower = grip[..., 2] - part.bottom_m
    tall = side_m * item_heights(layouts, heights)
    least = np.full(layouts.symbol.shape, np.inf)
    for slot in range(layouts.symbol.shape[1]):
        footprint = side_m * layouts.ends[:, slot][:, None]
        apart = segment_distance(ends, footprint) - part.radius_m - side_m * layouts.radius[:, slot, None]
        above = lower - tall[:, slot, None]
        both = np.hypot(np.maximum(apart, 0.0), np.maximum(above, 0.0))
        distance = np.where((apart < 0) & (above < 0), np.maximum(apart, above), both)
        least[:, slot] = np.where(layouts.present[:, slot], distance.min(-1), np.inf)
    return least
