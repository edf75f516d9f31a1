"""Collisions of an arm with its own robot, and with the table and the space that items take."""

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.robot.arm import Arm
from pipeline.robot.bench import Bench

THICK_M = 0.03  # thickness of the table's top


class Collisions:
    """Pairs of shapes that may meet: of the arm, of the rest of the robot, and the table.

    Shapes of neighbouring joints always touch and are left out, and so are those that touch in the preferred posture.
    """

    def __init__(self, arm: Arm, bench: Bench, obstacle_m: float):
        self.arm, shapes = arm, arm.shapes.copy()
        box = coal.Box(bench.side_m, bench.side_m, THICK_M + obstacle_m)
        middle = np.array([bench.side_m / 2, bench.side_m / 2, bench.height_m + (obstacle_m - THICK_M) / 2])
        table = shapes.addGeometryObject(
            pin.GeometryObject("table", 0, bench.base.inverse() * pin.SE3(np.eye(3), middle), box)
        )
        joints = np.array([shape.parentJoint for shape in shapes.geometryObjects])
        for first in range(len(joints)):
            for second in range(first + 1, len(joints)):
                if abs(joints[first] - joints[second]) > 1 and second != table:
                    shapes.addCollisionPair(pin.CollisionPair(first, second))
        self.shapes, self.data = shapes, arm.model.createData()
        for pair in self._touching(arm.posture):
            shapes.removeCollisionPair(pair)
        for shape in range(table):  # the robot's body, too: it must not stand in the table
            shapes.addCollisionPair(pin.CollisionPair(shape, table))
        self.geometry = pin.GeometryData(shapes)

    def _touching(self, q: Float[Array, " joint"]) -> list[pin.CollisionPair]:
        """Return the pairs that touch in a posture."""
        geometry = pin.GeometryData(self.shapes)
        pin.computeCollisions(self.arm.model, self.data, self.shapes, geometry, q, False)
        pairs = list(self.shapes.collisionPairs)
        return [pair for pair, result in zip(pairs, geometry.collisionResults, strict=True) if result.isCollision()]

    def at(self, q: Float[Array, " joint"]) -> bool:
        """Return whether any pair touches at joint positions [rad]."""
        return bool(pin.computeCollisions(self.arm.model, self.data, self.shapes, self.geometry, q, True))
