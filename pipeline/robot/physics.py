"""Simulate an execution in MuJoCo: the carried parts follow the grip and push what they meet."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from xml.sax.saxutils import quoteattr

import mujoco  # pyright: ignore[reportMissingImports]
import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.robot.carried import Part
from pipeline.world.layout import SYMBOLS, Layouts

STEP_S = 0.002  # of the simulation
SETTLE_S = 0.5  # time after the movement in which items may still fall
MIN_HALF_M = 0.001  # least half-size of a solid


@dataclass(frozen=True)
class Solid:
    """Hold height and mass of an item of a symbol at full size."""

    height_m: float
    mass_kg: float


@dataclass(frozen=True)
class Outcome:
    """Hold what happened to the items of one scene, one entry a slot."""

    touched: Bool[Array, " slot"]
    fallen: Bool[Array, " slot"]  # tilted beyond the limit at the end
    moved_m: Float[Array, " slot"]  # displacement at the end
    poses: Float[Array, "instant slot 7"]  # place [m] and unit quaternion (w first) at each instant; nan in empty slots


def simulate(
    layouts: Layouts,
    scene: int,
    side_m: float,
    solids: Mapping[str, Solid],
    parts: Sequence[Part],
    grip: Float[Array, "instant 3"],
    heading: Float[Array, " instant"],
    duration_s: float,
    fallen_rad: float,
) -> Outcome:
    """Move the parts along the grip [m] (table's frame) and heading [rad] in `duration_s`; return what they met.

    The parts cannot be pushed back. Items stand free and scale with the table: sizes by side_m, masses by side_m³.
    """
    slots = np.flatnonzero(layouts.present[scene])
    model = mujoco.MjModel.from_xml_string(_scene_xml(layouts, scene, slots, side_m, solids, parts))
    data = mujoco.MjData(model)
    owner = np.full(model.ngeom, -1)
    for slot in slots:
        body = model.body(f"item{slot}").id
        owner[model.geom_bodyid == body] = slot
    carried = model.geom_bodyid == model.body("carried").id
    bodies = np.array([model.body(f"item{slot}").id for slot in slots], int)
    free = model.jnt_qposadr[model.body_jntadr[bodies]][:, None] + np.arange(7)  # (item, 7) places in data.qpos
    start = data.qpos[free][:, :3]
    poses = np.full((len(grip), layouts.symbol.shape[1], 7), np.nan)
    touched = np.zeros(layouts.symbol.shape[1], bool)
    steps = round(duration_s / STEP_S)
    at = np.linspace(0, len(grip) - 1, steps + 1)
    path = np.stack([np.interp(at, np.arange(len(grip)), one) for one in grip.T], -1)
    half = np.interp(at, np.arange(len(grip)), np.unwrap(heading)) / 2
    turn = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], -1)
    instants = np.linspace(0, steps, len(grip)).round().astype(int)
    for step in range(steps + round(SETTLE_S / STEP_S)):
        poses[np.ix_(instants == step, slots)] = data.qpos[free]
        data.mocap_pos[0], data.mocap_quat[0] = path[min(step, steps)], turn[min(step, steps)]
        mujoco.mj_step(model, data)
        if data.ncon:
            pairs = data.contact.geom
            met = pairs[carried[pairs].any(1)]
            touched[owner[met[~carried[met]]]] = True
    fallen, moved = np.zeros_like(touched), np.zeros(len(touched))
    for slot, body, first in zip(slots, bodies, start, strict=True):
        fallen[slot] = np.arccos(np.clip(data.xmat[body][8], -1, 1)) > fallen_rad
        moved[slot] = np.linalg.norm((data.xpos[body] - first)[:2])
    return Outcome(touched, fallen, moved, poses)


def _scene_xml(
    layouts: Layouts, scene: int, slots: Array, side_m: float, solids: Mapping[str, Solid], parts: Sequence[Part]
) -> str:
    """Return the MuJoCo model of a scene: the table as a plane, free items, and the carried parts."""
    bodies = []
    for slot in slots:
        solid = solids[SYMBOLS[layouts.symbol[scene, slot]]]
        half = max(side_m * solid.height_m / 2, MIN_HALF_M)
        x, y = side_m * layouts.centre[scene, slot]
        radius, length = (side_m * float(values[scene, slot]) for values in (layouts.radius, layouts.half_length))
        geoms = _prism(-length, length, radius, -half, half, f'mass="{side_m**3 * solid.mass_kg:.6g}"')
        turn = f'euler="0 0 {layouts.angle[scene, slot]:.6f}"'
        where = f'name="item{slot}" pos="{x:.6f} {y:.6f} {half:.6f}" {turn}'
        bodies.append(f"<body {where}><freejoint/>{geoms}</body>")
    shapes = "".join(_prism(p.back_m, p.front_m, p.radius_m, -p.bottom_m, p.top_m, "") for p in parts)
    return (
        f'<mujoco model={quoteattr("table")}><compiler angle="radian"/><option timestep="{STEP_S}"/><worldbody>'
        f'<geom type="plane" size="1 1 0.1"/>{"".join(bodies)}<body name="carried" mocap="true" pos="0 0 1">{shapes}'
        "</body></worldbody></mujoco>"
    )


def _prism(back: float, front: float, radius: float, bottom: float, top: float, mass: str) -> str:
    """Return an upright prism over a capsule along x: a cylinder at each end and a box between them."""
    half, middle = (top - bottom) / 2, (top + bottom) / 2
    ends = {back, front}
    solid = "".join(
        f'<geom type="cylinder" size="{radius:.6f} {half:.6f}" pos="{x:.6f} 0 {middle:.6f}" {mass}/>'
        for x in sorted(ends)
    )
    if len(ends) == 1:
        return solid
    size, centre = f"{(front - back) / 2:.6f} {radius:.6f} {half:.6f}", f"{(front + back) / 2:.6f} 0 {middle:.6f}"
    return solid + f'<geom type="box" size="{size}" pos="{centre}" {mass}/>'
