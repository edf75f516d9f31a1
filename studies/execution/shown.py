"""Gather what the picture and the recording show: one path before its repair and after it."""

from dataclasses import fields

import numpy as np
import pandas as pd
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.robot.arm import GRIP, Arm
from pipeline.robot.bench import Bench
from pipeline.robot.carried import clearances, item_heights
from pipeline.robot.physics import simulate
from pipeline.world.layout import Layouts
from studies.execution.paths import UNREPAIRED
from studies.execution.work import Work

SMALLEST_M = 0.02  # bodies of the robot below this size are left out


def shown(
    work: Work, repaired: pd.DataFrame, paths: pd.DataFrame, images: Array, layouts: Layouts
) -> dict[str, np.ndarray]:
    """Return scene, image, z_theta, and what happens along both paths; first axis: before and after the repair.

    Lengths are in metres in the table's frame, z above its top. chain (path, instant, joint, 3): joints and grip;
    thickness (joint): radii around the chain; bodies: boxes around what holds the arm; clearance (path, instant): of
    shaker and gripper; items (path, instant, slot, 7): places and quaternions in the simulation; share (path, instant,
    joint): positions within the joints' ranges; layout/...: the scene's layout on a table of 1 m.
    """
    after = repaired[repaired["scene"] >= work.study.shown_scene].iloc[0]
    drawn = paths[(paths["method"] == UNREPAIRED) & (paths["user"] == after["user"])]
    before = drawn[(drawn["scene"] == after["scene"]) & (drawn["start"] == after["start"])].iloc[0]
    z_theta = np.array([[row["z_x"], row["z_y"]] for row in (before, after)], float)
    scene, motion = int(after["scene"]), work.run(z_theta)
    layout, model, side_m = layouts[scene : scene + 1], work.arm.model, work.bench.side_m
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    seconds, instants = motion.results["duration_s"].to_numpy(), motion.q.shape[1]
    clear = [
        [clearances(part, grip[:, None], turn[:, None], layout[[0] * instants], side_m, work.heights()).min(1)
         for part in work.parts()]
        for grip, turn in zip(motion.grip, motion.heading, strict=True)
    ]  # fmt: skip
    met = [
        simulate(layout, 0, side_m, work.solids(), work.parts(), grip, turn, duration, work.study.fallen_rad)
        for grip, turn, duration in zip(motion.grip, motion.heading, seconds, strict=True)
    ]
    shaker = work.study.shaker
    return {
        "scene": np.array(scene),
        "image": images[scene],
        "side_m": np.array(side_m),
        "z_theta": z_theta,
        "t": np.linspace(0.0, seconds, instants, axis=1),
        "grip": motion.grip,
        "chain": np.stack([[chain(work.arm, work.bench, q) for q in path] for path in motion.q]),
        "thickness": thickness(work.arm),
        "bodies": bodies(work.arm, work.bench),
        "shaker": np.array([shaker.radius_m, shaker.below_m, shaker.above_m]),
        "clearance": np.min(clear, axis=1),
        "items": np.stack([one.poses for one in met]),
        "heights": side_m * item_heights(layout, work.heights())[0],
        "share": (motion.q - low) / (high - low),
        "joints": np.array(work.arm.joints),
    } | {f"layout/{field.name}": getattr(layout, field.name) for field in fields(layout)}


def chain(arm: Arm, bench: Bench, q: Float[Array, " joint"]) -> Float[Array, "place 3"]:
    """Return the places [m] of the joints, and then of the grip, in the table's frame."""
    data = arm.model.createData()
    pin.framesForwardKinematics(arm.model, data, q)
    places = [data.oMi[joint].translation for joint in range(1, arm.model.njoints)]
    return bench.to_table(np.array([*places, data.oMf[arm.model.getFrameId(GRIP)].translation]))


def thickness(arm: Arm) -> Float[Array, " joint"]:
    """Return half the thinnest side [m] of the thickest shape that each joint moves."""
    half = np.zeros(arm.model.njoints)
    for shape in arm.shapes.geometryObjects:
        half[shape.parentJoint] = max(half[shape.parentJoint], sides(shape).min() / 2)
    return half[1:]


def bodies(arm: Arm, bench: Bench) -> Float[Array, "body 10"]:
    """Return boxes around the shapes that no joint moves: sides, centre [m], and quaternion (x, y, z, w)."""
    to_table = pin.SE3(np.eye(3), np.array([0.0, 0.0, -bench.height_m])) * bench.base
    rows = []
    for shape in arm.shapes.geometryObjects:
        size = sides(shape)
        if shape.parentJoint == 0 and size.max() > SMALLEST_M:
            middle = (shape.geometry.aabb_local.min_ + shape.geometry.aabb_local.max_) / 2
            pose = to_table * shape.placement * pin.SE3(np.eye(3), middle)
            rows.append([*size, *pose.translation, *pin.Quaternion(pose.rotation).coeffs()])
    return np.array(rows)


def sides(shape: pin.GeometryObject) -> Float[Array, "3"]:
    """Return the sides [m] of the box around a shape."""
    shape.geometry.computeLocalAABB()
    return np.asarray(shape.geometry.aabb_local.max_ - shape.geometry.aabb_local.min_)
