"""From a photograph to the model's table: a homography to the table, then a similarity to the model's start and goal.

The models know one start and one goal, P_INIT and P_F. Another start and goal are mapped there by moving, turning and
scaling picture and paths together, which keeps angles and ratios of lengths. One metre on the table is `scale` metres
to the model.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.layout import SIDE

CANVAS_PX = 4 * SIDE  # side of a rectified table: fine enough to place cut-outs at a quarter of a model's pixel
MAX_FINER = 4  # a photograph is warped at up to this many times CANVAS_PX, then averaged, so that nothing aliases
SMOOTH_PX = 101  # the median that removes objects from the rim which continues the table beyond its edge
RIM_PX = CANVAS_PX // 100  # the canvas' outermost hundredth repeats its neighbour: nobody marks corners to the pixel
CIRCLE = np.linspace(0, 2 * np.pi, 48)  # bearings of an outline's points


@dataclass(frozen=True)
class Frame:
    """The similarity from metres on the table to the model's: model = matrix @ table + shift; side_m: the table's."""

    side_m: float
    matrix: Float[Array, "2 2"]
    shift: Float[Array, "2"]

    @classmethod
    def between(cls, side_m: float, start: Float[Array, "2"], goal: Float[Array, "2"]) -> "Frame":
        """Return the frame in which start and goal [m on the table], which differ, are P_INIT and P_F."""
        first, last, begin, end = (complex(*map(float, p)) for p in (start, goal, P_INIT, P_F))
        turn = (end - begin) / (last - first)
        shift = begin - turn * first
        matrix = np.array([[turn.real, -turn.imag], [turn.imag, turn.real]])
        return cls(side_m, matrix, np.array([shift.real, shift.imag]))

    @property
    def scale(self) -> float:
        """Return how many of the model's metres one metre on the table is."""
        return float(np.hypot(*self.matrix[0]))

    @property
    def is_whole_table(self) -> bool:
        """Return whether the model sees the whole table unturned, as without a `start` and `goal`."""
        return np.allclose(self.matrix * self.side_m, np.eye(2), 0, 1e-9) and np.allclose(self.shift, 0, 0, 1e-9)

    @property
    def degrees(self) -> float:
        """Return the counter-clockwise turn [degrees]."""
        return float(np.degrees(np.arctan2(*self.matrix[::-1, 0])))

    def to_model(self, points: Float[Array, "*p 2"]) -> Float[Array, "*p 2"]:
        """Return points on the table [m] as the model's [m]."""
        return np.asarray(points, float) @ self.matrix.T + self.shift

    def to_table(self, points: Float[Array, "*p 2"]) -> Float[Array, "*p 2"]:
        """Return the model's points [m] on the table [m]."""
        return (np.asarray(points, float) - self.shift) @ self.matrix / self.scale**2

    def image(self, canvas: UInt8[Array, "side side 3"], side_px: int = SIDE) -> UInt8[Array, "px px 3"]:
        """Return the model's image of a rectified table, 100 pixels a side unless it is for people.

        Beyond the table's edge it continues the colours of the rim without their objects, so that the edge is no
        object either.
        """
        if not self.is_whole_table:
            corners, size, borders = whole(CANVAS_PX, CANVAS_PX), canvas.shape[:2], cv2.BORDER_REPLICATE
            model = self.to_model((corners * [1, -1] + [0, CANVAS_PX]) / CANVAS_PX * self.side_m)
            matrix = homography(corners, (model * [1, -1] + [0, 1]) * CANVAS_PX)
            inside, beyond = (
                cv2.warpPerspective(layer, matrix, size, borderMode=borders)
                for layer in (canvas, cv2.medianBlur(canvas, SMOOTH_PX))
            )
            on_table = cv2.warpPerspective(np.full(size, 255, np.uint8), matrix, size, flags=cv2.INTER_NEAREST)
            canvas = np.where(on_table[..., None] > 0, inside, beyond)
        return cv2.resize(canvas, (side_px, side_px), interpolation=cv2.INTER_AREA)


def whole(width: int, height: int) -> Float[Array, "4 2"]:
    """Return the corners [column, row] of a picture: far left, far right, near right, near left."""
    return np.array([[0, 0], [width, 0], [width, height], [0, height]], float)


def homography(corners: Float[Array, "4 2"], others: Float[Array, "4 2"]) -> Float[Array, "3 3"]:
    """Return the matrix between places in pixels as OpenCV warps: it counts from the first pixel's centre."""
    return cv2.getPerspectiveTransform((corners - 0.5).astype(np.float32), (others - 0.5).astype(np.float32))


def rectify(picture: UInt8[Array, "row column 3"], corners: Float[Array, "4 2"] | None) -> UInt8[Array, "side side 3"]:
    """Return the table seen from straight above, CANVAS_PX pixels a side.

    corners: [column, row] in the picture, far left, far right, near right, near left; None: the whole picture.
    """
    corners = whole(*picture.shape[1::-1]) if corners is None else corners
    longest = max(np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1))
    side = CANVAS_PX * int(np.clip(np.ceil(longest / CANVAS_PX), 1, MAX_FINER))
    matrix = homography(corners, whole(side, side))
    warped = cv2.warpPerspective(picture, matrix, (side, side), flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    canvas = cv2.resize(warped, (CANVAS_PX, CANVAS_PX), interpolation=cv2.INTER_AREA)
    inner = np.ascontiguousarray(canvas[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX])
    return cv2.copyMakeBorder(inner, RIM_PX, RIM_PX, RIM_PX, RIM_PX, cv2.BORDER_REPLICATE)


def outline(ends: Float[Array, "2 2"], radius: float | np.floating) -> Float[Array, "point 2"]:
    """Return the outline of a capsule: all points within `radius` of a segment."""
    circle = radius * np.stack([np.cos(CIRCLE), np.sin(CIRCLE)], -1)
    return np.where((circle @ (ends[1] - ends[0]) > 0)[:, None], ends[1], ends[0]) + circle
