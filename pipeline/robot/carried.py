"""The gripper and what it carries among the items on the table, in MuJoCo.

Items stand on the table as upright prisms over their footprints. A carried part is an upright prism over a capsule.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import coal  # pyright: ignore[reportMissingImports]
import mujoco  # pyright: ignore[reportMissingImports]
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.robot.arm import GRIP, Arm
from pipeline.world.layout import SYMBOLS, Layouts

STEP_S = 0.002  # of the simulation
SETTLE_S = 0.5  # time after the movement in which items may still fall
MIN_HALF_M = 0.001  # least half-size of a solid


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


def simulate(
    layouts: Layouts,
    scene: int,
    side_m: float,
    heights: Mapping[str, float],
    masses: Mapping[str, float],
    parts: Sequence[Part],
    grip: Float[Array, "instant 3"],
    heading: Float[Array, " instant"],
    duration_s: float,
) -> tuple[Bool[Array, " slot"], Float[Array, " slot"]]:
    """Move the parts along the grip [m] (table's frame) and heading [rad] in `duration_s`, and push what they meet.

    The parts cannot be pushed back. Items stand free and scale with the table: heights [m] by side_m, masses [kg] by
    side_m³. Return which were touched, and how far each is tilted [rad] at the end.
    """
    slots, items = np.flatnonzero(layouts.present[scene]), ""
    for slot in slots:
        symbol = SYMBOLS[layouts.symbol[scene, slot]]
        half = max(side_m * heights[symbol] / 2, MIN_HALF_M)
        x, y = side_m * layouts.centre[scene, slot]
        radius, length = (side_m * float(values[scene, slot]) for values in (layouts.radius, layouts.half_length))
        geoms = _prism(-length, length, radius, -half, half, f'mass="{side_m**3 * masses[symbol]:.6g}"')
        where = f'pos="{x:.6f} {y:.6f} {half:.6f}" euler="0 0 {layouts.angle[scene, slot]:.6f}"'
        items += f'<body name="item{slot}" {where}><freejoint/>{geoms}</body>'
    shapes = "".join(_prism(part.back_m, part.front_m, part.radius_m, -part.bottom_m, part.top_m) for part in parts)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco model="table"><compiler angle="radian"/><option timestep="{STEP_S}"/><worldbody>'
        f'<geom type="plane" size="1 1 0.1"/>{items}<body name="carried" mocap="true" pos="0 0 1">{shapes}'
        "</body></worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    bodies = np.array([model.body(f"item{slot}").id for slot in slots], int)
    slot_of = np.full(model.nbody, -1)
    slot_of[bodies] = slots
    carried = model.geom_bodyid == model.body("carried").id
    touched, tilted = np.zeros(layouts.symbol.shape[1], bool), np.zeros(layouts.symbol.shape[1])
    steps = round(duration_s / STEP_S)
    at = np.linspace(0, len(grip) - 1, steps + 1)
    path = np.stack([np.interp(at, np.arange(len(grip)), one) for one in grip.T], -1)
    half = np.interp(at, np.arange(len(grip)), np.unwrap(heading)) / 2
    turn = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], -1)
    for step in range(steps + round(SETTLE_S / STEP_S)):
        data.mocap_pos[0], data.mocap_quat[0] = path[min(step, steps)], turn[min(step, steps)]
        mujoco.mj_step(model, data)
        if data.ncon:
            pairs = data.contact.geom
            met = pairs[carried[pairs].any(1)]
            touched[slot_of[model.geom_bodyid[met[~carried[met]]]]] = True
    tilted[slots] = np.arccos(np.clip(data.xmat[bodies, 8], -1, 1))
    return touched, tilted


def _prism(back: float, front: float, radius: float, bottom: float, top: float, mass: str = "") -> str:
    """Return an upright prism over a capsule along x: a cylinder at each end and a box between them."""
    half, middle = (top - bottom) / 2, (top + bottom) / 2
    solid = "".join(
        f'<geom type="cylinder" size="{radius:.6f} {half:.6f}" pos="{x:.6f} 0 {middle:.6f}" {mass}/>'
        for x in sorted({back, front})
    )
    if back == front:
        return solid
    size, centre = f"{(front - back) / 2:.6f} {radius:.6f} {half:.6f}", f"{(front + back) / 2:.6f} 0 {middle:.6f}"
    return solid + f'<geom type="box" size="{size}" pos="{centre}" {mass}/>'
