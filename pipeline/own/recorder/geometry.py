"""Pixels of a picture to metres on the table and back, by the homography of the table's four corners (OpenCV)."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError

MIN_DEPTH = 1e-9  # relative to the picture's corner; no point of a table is so near to its horizon


@dataclass(frozen=True)
class View:
    """Map pixels of a picture to the table and back [m]: where its corners are, and the homography between the two."""

    corners: Float[Array, "4 2"]  # far left, far right, near right, near left, [column, row] in pixels
    matrix: Float[Array, "3 3"]  # from pixels to metres: near left corner to (0, 0), far right to (side, side)

    @classmethod
    def of(cls, corners: Float[Array, "4 2"], side_m: float) -> "View":
        """Return the view of a table of this side [m] with these corners."""
        table = np.array([[0, side_m], [side_m, side_m], [side_m, 0], [0, 0]])
        matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), table.astype(np.float32))
        depth = corners.mean(axis=0) @ matrix[2, :2] + matrix[2, 2]
        return cls(corners, matrix * np.sign(depth))  # depths are positive on this side of the table's horizon

    def metres(self, points: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
        """Return pixels as metres on the table; raise InputError for points at or beyond the table's horizon."""
        return _transform(self.matrix, points)

    def pixels(self, points: Float[Array, "n 2"]) -> list[list[float]]:
        """Return metres on the table as pixels, to a tenth; raise InputError as `metres`."""
        return np.round(_transform(np.linalg.inv(self.matrix), points), 1).tolist()


def _transform(matrix: Float[Array, "3 3"], points: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
    depths = points @ matrix[2, :2] + matrix[2, 2]
    if (depths <= MIN_DEPTH).any():
        raise InputError("a point lies above the horizon of the table: draw on the table")
    return cv2.perspectiveTransform(points[:, None].astype(np.float64), matrix)[:, 0]
