"""From a photograph to the model's table: a homography to the table, then a scale.

The model's table is a square with a side of 1 m. A person's table lies in its near left corner, and its longer side is
1 m to the model. Beyond a shorter side the square continues the median colours across the table.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.world.layout import SIDE

CANVAS_PX = 4 * SIDE  # side of a rectified table: fine enough to place cut-outs at a quarter of a model's pixel
MAX_FINER = 4  # a photograph is warped at up to this many times CANVAS_PX, then averaged, so that nothing aliases
SMOOTH_PX = 101  # of the median along the rim, after one across the table: no object colours what continues it
RIM_PX = CANVAS_PX // 100  # the canvas' outermost hundredth repeats its neighbour: nobody marks corners to the pixel
MIN_DEPTH = 1e-9  # relative to the picture's corner; no point of a table is so near to its horizon
CIRCLE = np.linspace(0, 2 * np.pi, 48)  # bearings of an outline's points


@dataclass(frozen=True)
class Frame:
    """The scale between metres on a table of this width and depth [m] and the model's metres."""

    size_m: tuple[float, float]

    @property
    def scale(self) -> float:
        """Return how many of the model's metres one metre on the table is."""
        return 1 / max(self.size_m)

    def to_model(self, points: Float[Array, "*p 2"]) -> Float[Array, "*p 2"]:
        """Return points on the table [m] as the model's [m]."""
        return np.asarray(points, float) * self.scale

    def to_table(self, points: Float[Array, "*p 2"]) -> Float[Array, "*p 2"]:
        """Return the model's points [m] on the table [m]."""
        return np.asarray(points, float) / self.scale

    def image(self, canvas: UInt8[Array, "side side 3"], side_px: int = SIDE) -> UInt8[Array, "px px 3"]:
        """Return the model's image of a rectified table, 100 pixels a side unless it is for people."""
        return cv2.resize(canvas, (side_px, side_px), interpolation=cv2.INTER_AREA)


def whole(width: int, height: int) -> Float[Array, "4 2"]:
    """Return the corners [column, row] of a picture: far left, far right, near right, near left."""
    return np.array([[0, 0], [width, 0], [width, height], [0, height]], float)


def to_metres(corners: Float[Array, "4 2"], size_m: Sequence[float] | Array) -> Float[Array, "3 3"]:
    """Return the matrix from a picture's places [px] to metres on the table, whose near left corner is (0, 0)."""
    table = np.asarray(size_m) * np.array([[0, 1], [1, 1], [1, 0], [0, 0]])
    matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), table.astype(np.float32))
    depth = corners.mean(axis=0) @ matrix[2, :2] + matrix[2, 2]
    return matrix * np.sign(depth)  # depths are positive on this side of the table's horizon


def on_this_side(matrix: Float[Array, "3 3"], points: Float[Array, "n 2"]) -> Bool[Array, " n"]:
    """Return which points lie on the picture's side of the table's horizon."""
    return points @ matrix[2, :2] + matrix[2, 2] > MIN_DEPTH


def mapped(matrix: Float[Array, "3 3"], points: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
    """Return points under a homography; raise InputError for points at or beyond the table's horizon."""
    if not on_this_side(matrix, points).all():
        raise InputError("a point lies above the horizon of the table: draw on the table")
    return cv2.perspectiveTransform(points[:, None].astype(np.float64), matrix)[:, 0]


def rectify(
    picture: UInt8[Array, "row column 3"], corners: Float[Array, "4 2"] | None, size_m: Sequence[float] | Array = (1, 1)
) -> UInt8[Array, "side side 3"]:
    """Return the table seen from straight above in a square, CANVAS_PX pixels a side; its far edge is row 0.

    corners: [column, row] in the picture, far left, far right, near right, near left; None: the whole picture.
    size_m: width and depth of the table; only their ratio matters here.
    """
    corners = whole(*picture.shape[1::-1]) if corners is None else corners
    columns, rows = (max(1, round(CANVAS_PX * each / max(size_m))) for each in size_m)
    longest = max(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1))
    finer = int(np.clip(np.ceil(longest / CANVAS_PX), 1, MAX_FINER))
    size = finer * columns, finer * rows
    seen, wanted = ((each - 0.5).astype(np.float32) for each in (corners, whole(*size)))  # from a pixel's centre
    matrix, borders = cv2.getPerspectiveTransform(seen, wanted), cv2.BORDER_REPLICATE
    warped = cv2.warpPerspective(picture, matrix, size, flags=cv2.INTER_LINEAR, borderMode=borders)
    table = cv2.resize(warped, (columns, rows), interpolation=cv2.INTER_AREA)
    inner = np.ascontiguousarray(table[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX])
    table = cv2.copyMakeBorder(inner, RIM_PX, RIM_PX, RIM_PX, RIM_PX, borders)
    if columns == rows:
        return table
    across = int(rows > columns)  # the axis of the shorter side
    rim = np.median(table, axis=across, keepdims=True).astype(np.uint8)  # (1, columns, 3) or (rows, 1, 3)
    canvas = np.broadcast_to(cv2.medianBlur(rim, SMOOTH_PX).reshape(rim.shape), (CANVAS_PX, CANVAS_PX, 3)).copy()
    canvas[CANVAS_PX - rows :, :columns] = table
    return canvas


def outline(ends: Float[Array, "2 2"], radius: float | np.floating) -> Float[Array, "point 2"]:
    """Return the outline of a capsule: all points within `radius` of a segment."""
    circle = radius * np.stack([np.cos(CIRCLE), np.sin(CIRCLE)], -1)
    return np.where((circle @ (ends[1] - ends[0]) > 0)[:, None], ends[1], ends[0]) + circle
