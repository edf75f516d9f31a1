"""Take the picture of the empty table from pictures of several arrangements under a fixed camera.

Each place of the table is free in most pictures, so its median colour is the table's. Before, pictures are moved onto
the first median by phase correlation, and their light is brought to its.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8
from numpy import ndarray as Array

MIN_PICTURES = 5  # fewer show too little of the table
MAX_SHIFT = 0.02  # of the table's side: a camera that moved farther is another camera
MIN_SHIFT = 0.002  # less is left as it is
GAIN = 0.5, 2.0  # range of light, over the median's
ALIKE = 14.0  # grey levels within which a picture shows the same as the median
MIN_ALIKE = 0.5  # share of the pictures that must, or the place is unsure
MAX_UNSURE = 0.25  # share of the table


class Empty(NamedTuple):
    """The empty table as its pictures tell it."""

    canvas: UInt8[Array, "side side 3"]
    unsure: Bool[Array, "side side"]  # where fewer than MIN_ALIKE of the pictures agree
    moved: list[int]  # pictures that show the table elsewhere: not used
    relit: list[int]  # pictures in another light: not used

    @property
    def is_useful(self) -> bool:
        """Return whether it shows most of the table."""
        return bool(self.unsure.mean() <= MAX_UNSURE)


def empty_table(canvases: UInt8[Array, "picture side side 3"]) -> Empty | None:
    """Return the empty table of pictures of one table, or None if fewer than MIN_PICTURES remain."""
    count, side = canvases.shape[:2]
    if count < MIN_PICTURES:
        return None
    stack = canvases.astype(np.float32)
    shifts, gains = np.zeros((count, 2)), np.ones((count, 3))
    for _ in range(2):
        middle = np.median(stack, axis=0)
        for i, picture in enumerate(canvases):
            gains[i] = np.median((middle + 1) / (picture + np.float32(1)), axis=(0, 1))
            lit = picture * gains[i].astype(np.float32)
            shifts[i] = _shift(lit, middle)
            stack[i] = _moved(lit, shifts[i])
    near = (np.abs(stack - np.median(stack, axis=0)).max(-1) < ALIKE).mean((1, 2))
    moved = [i for i in range(count) if np.abs(shifts[i]).max() > MAX_SHIFT * side or near[i] < MIN_ALIKE]
    relit = [i for i in range(count) if not ((GAIN[0] < gains[i]) & (gains[i] < GAIN[1])).all() and i not in moved]
    used = [i for i in range(count) if i not in moved + relit]
    if len(used) < MIN_PICTURES:
        return None
    middle = np.median(stack[used], axis=0)
    alike = (np.abs(stack[used] - middle).max(-1) < ALIKE).mean(0)
    return Empty(np.clip(np.rint(middle), 0, 255).astype(np.uint8), alike < MIN_ALIKE, moved, relit)


def _shift(picture: Float32[Array, "side side 3"], middle: Float32[Array, "side side 3"]) -> Array:
    """Return by how many pixels (columns, rows) a picture must move, 0 unless that brings it nearer to the median."""
    side = len(picture)
    grey, onto = picture.mean(-1), middle.mean(-1)
    window = cv2.createHanningWindow((side, side), cv2.CV_32F)
    (right, down), _ = cv2.phaseCorrelate(grey - grey.mean(), onto - onto.mean(), window)
    shift = np.array([right, down])
    if np.abs(shift).max() < MIN_SHIFT * side:
        return np.zeros(2)
    before, after = (float(np.median(np.abs(x - middle))) for x in (picture, _moved(picture, shift)))
    return shift if after < 0.9 * before else np.zeros(2)


def _moved(picture: Float32[Array, "side side 3"], shift: Array) -> Float32[Array, "side side 3"]:
    """Return a picture moved by (columns, rows) pixels."""
    if not shift.any():
        return picture
    matrix = np.column_stack([np.eye(2), shift])
    return cv2.warpAffine(picture, matrix, picture.shape[1::-1], borderMode=cv2.BORDER_REPLICATE)
