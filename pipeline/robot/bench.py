"""Place the 1 m table of the scenes before a robot, at a size that its arm can cover."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from jaxtyping import Float
from numpy import ndarray as Array


@dataclass(frozen=True)
class Bench:
    """A table and a robot's base beside it, in metres.

    All lengths of a scene, items' heights included, are multiplied by `side_m`; the arm and what it carries are not.
    """

    side_m: float  # side of the table; a scene's lengths are those of a table of 1 m
    base_x: float  # of the robot's base [m]: x to the right along the near edge, from its left end
    base_y: float  # y away from the robot; negative: before the near edge
    turn_deg: float  # direction in which the robot looks, from the x axis
    height_m: float  # of the table's top above the floor on which the base stands
    grip_m: float  # of the grip above the table's top

    @property
    def base(self) -> pin.SE3:
        """Return the pose of the base in the frame of the table, on the floor below its near left corner."""
        return pin.SE3(pin.utils.rotate("z", np.deg2rad(self.turn_deg)), np.array([self.base_x, self.base_y, 0.0]))

    def to_base(self, points: Float[Array, "*point 2"]) -> Float[Array, "*point 3"]:
        """Return points of a scene [table sides] at the grip's height in the base's frame [m]."""
        flat = self.side_m * np.asarray(points, float)
        height = np.full((*flat.shape[:-1], 1), self.height_m + self.grip_m)
        return (np.concatenate([flat, height], -1) - self.base.translation) @ self.base.rotation

    def to_table(self, points: Float[Array, "*point 3"]) -> Float[Array, "*point 3"]:
        """Return points in the base's frame [m] in the frame of the table [m], with z above its top."""
        return points @ self.base.rotation.T + self.base.translation - [0.0, 0.0, self.height_m]
