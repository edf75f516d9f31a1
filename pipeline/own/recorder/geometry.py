"""Pixels of a picture to metres on the table and back, by the homography of the table's four corners (OpenCV)."""

import cv2
import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError

MIN_DEPTH = 1e-9  # relative to the picture's corner; no point of a table is so near to its horizon


def homography(corners: Float[Array, "4 2"], side_m: float) -> Float[Array, "3 3"]:
    """Return the homography from pixels to metres: near left corner to (0, 0), far right to (side, side).

    corners: far left, far right, near right, near left, [column, row] in pixels.
    """
    table = np.array([[0, side_m], [side_m, side_m], [side_m, 0], [0, 0]])
    matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), table.astype(np.float32))
    depth = corners.mean(axis=0) @ matrix[2, :2] + matrix[2, 2]
    return matrix * np.sign(depth)  # depths are positive on this side of the table's horizon


def transform(matrix: Float[Array, "3 3"], points: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
    """Return the points mapped by a homography; raise InputError for points at or beyond the table's horizon."""
    depths = points @ matrix[2, :2] + matrix[2, 2]
    if (depths <= MIN_DEPTH).any():
        raise InputError("a point lies above the horizon of the table: draw on the table")
    return cv2.perspectiveTransform(points[:, None].astype(np.float64), matrix)[:, 0]


def capsule(
    centre: Float[Array, "2"], radius: float, half_length: float = 0.0, angle_deg: float = 0.0
) -> Float[Array, "n 2"]:
    """Return the outline of a capsule: all points within `radius` of a segment; a circle without `half_length`."""
    turn = np.linspace(-np.pi / 2, np.pi / 2, 17)
    cap = radius * np.stack([np.cos(turn), np.sin(turn)], axis=-1) + [half_length, 0]
    outline = np.concatenate([cap, -cap])
    c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    return centre + outline @ np.array([[c, s], [-s, c]])


def grid(side_m: float) -> list[Float[Array, "2 2"]]:
    """Return the ends [m] of the lines that divide a table into ten fields a side."""
    tenths = np.linspace(0, side_m, 11)[1:-1]
    lines = [np.array([[tenth, 0], [tenth, side_m]]) for tenth in tenths]
    return lines + [line[:, ::-1] for line in lines]
