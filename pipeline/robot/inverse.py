"""Inverse kinematics over the table by pink: one posture for each point of a lattice, which paths then interpolate.

The grip keeps its height and stays upright; its heading and the elbow are free, and go where the posture is nearest to
the preferred one. So joint positions are a function of the point on the table, and all paths share one map.
"""

from dataclasses import dataclass

import numpy as np
import pink  # pyright: ignore[reportMissingImports]
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Float, Int
from numpy import ndarray as Array
from pink.limits import ConfigurationLimit  # pyright: ignore[reportMissingImports]
from pink.tasks import FrameTask, PostureTask  # pyright: ignore[reportMissingImports]
from scipy.ndimage import map_coordinates, spline_filter

from pipeline.robot.arm import GRIP, Arm, Bench, Collisions

FREE, REACH, COLLISION, OFF = range(4)  # status of a point: the arm gets there, or why not; OFF: off the table
REACHED_M, REACHED_RAD = 1e-3, 0.01  # a point counts as reached within this distance and tilt
TILT_COST = 0.3  # [m/rad] of tilt against distance
POSTURE_COST = 3e-3  # [m/rad] of leaving the preferred posture: too small to move the grip by a millimetre
SOLVED = 1e-4  # a step is the last if no joint moves further [rad]
FIRST, STEPS = 200, 12  # most steps for the first point, from the preferred posture, and from a neighbour
POLISHING = 3  # most steps from an interpolated posture


@dataclass(frozen=True)
class PostureMap:
    """Joint positions [rad] and status over the table, both (row, column) with row 0 at the near edge."""

    q: Float[Array, "side side joint"]
    status: Int[Array, "side side"]
    coefficients: Float[Array, "joint side side"]  # of cubic splines through q

    def postures(self, points: Float[Array, "*point 2"]) -> Float[Array, "*point joint"]:
        """Return joint positions [rad] at points of a scene [table sides], by cubic splines."""
        at = np.moveaxis(np.asarray(points)[..., ::-1], -1, 0) * (len(self.q) - 1)
        joints = [map_coordinates(c, at, order=3, mode="nearest", prefilter=False) for c in self.coefficients]
        return np.stack(joints, -1)

    def worst(self, points: Float[Array, "*path point 2"]) -> Int[Array, "*path"]:
        """Return the gravest status along each path, at the lattice points nearest to its points.

        The map ends at the table's edge.
        """
        index = np.round(np.asarray(points)[..., ::-1] * (len(self.q) - 1)).astype(int)
        row, column = np.moveaxis(index.clip(0, len(self.q) - 1), -1, 0)
        beyond = (np.abs(np.asarray(points) - 0.5) > 0.5).any(-1)
        return np.where(beyond, OFF, self.status[row, column]).max(-1)


def posture_map(arm: Arm, bench: Bench, side: int, obstacle_m: float) -> PostureMap:
    """Solve the map on a lattice of `side` x `side` points, outwards from the middle, each from a solved neighbour.

    obstacle_m: height above the table that the arm must not enter, since items stand there.
    """
    axis = np.linspace(0.0, 1.0, side)
    points = np.stack(np.meshgrid(axis, axis), -1)  # (row, column, 2)
    targets = bench.to_base(points)
    away = np.linalg.norm(points - 0.5, axis=-1)
    collisions = Collisions(arm, bench, obstacle_m)
    solver = Solver(arm)
    q = np.full((side, side, arm.model.nq), np.nan)
    status = np.full((side, side), -1)
    for row, column in zip(*np.unravel_index(np.argsort(away, axis=None, kind="stable"), away.shape), strict=True):
        near = np.s_[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        known = status[near] >= 0
        start = arm.posture
        if known.any():
            order = np.lexsort((away[near][known], status[near][known] != FREE))
            start = q[near][known][order[0]]
        steps = STEPS if known.any() else FIRST
        q[row, column], reached = solver.solve(start, targets[row, column], steps)
        status[row, column] = REACH if not reached else COLLISION if collisions.at(q[row, column]) else FREE
    return PostureMap(q, status, np.stack([spline_filter(q[..., i], 3, mode="nearest") for i in range(q.shape[-1])]))


class Solver:
    """Pink's steps to an upright grip at a point, within the joints' stops."""

    def __init__(self, arm: Arm):
        self.configuration = pink.Configuration(arm.model, arm.model.createData(), arm.posture)
        self.grip = FrameTask(GRIP, 1.0, [TILT_COST, TILT_COST, 0.0])
        self.posture = PostureTask(POSTURE_COST)
        self.posture.set_target(arm.posture)
        self.limits = [ConfigurationLimit(arm.model, config_limit_gain=0.9)]

    def solve(
        self, start: Float[Array, " joint"], target: Float[Array, "3"], steps: int
    ) -> tuple[Float[Array, " joint"], bool]:
        """Return joint positions [rad] with the grip nearest to the target [m], and whether it is reached."""
        self.configuration.update(start)
        for _ in range(steps):
            here = self.configuration.get_transform_frame_to_world(GRIP)
            upright = pin.Quaternion.FromTwoVectors(here.rotation[:, 2], np.array([0.0, 0.0, 1.0])).matrix()
            self.grip.set_target(pin.SE3(upright @ here.rotation, target))
            tasks = [self.grip, self.posture]
            step = pink.solve_ik(self.configuration, tasks, 1.0, "daqp", damping=1e-8, limits=self.limits)
            self.configuration.integrate_inplace(step, 1.0)
            if np.abs(step).max() < SOLVED:
                break
        here = self.configuration.get_transform_frame_to_world(GRIP)
        tilt = np.arccos(np.clip(here.rotation[2, 2], -1.0, 1.0))
        reached = bool(np.linalg.norm(here.translation - target) < REACHED_M and tilt < REACHED_RAD)
        return self.configuration.q.copy(), reached
