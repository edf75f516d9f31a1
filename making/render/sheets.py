"""Lay pictures out as one contact sheet, and take them apart again."""

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.world.layout import SIDE

PER_ROW = 10  # pictures in a row


def sheet(images: UInt8[Array, "scene 100 100 3"]) -> UInt8[Array, "row column 3"]:
    """Return a contact sheet of the pictures, PER_ROW in a row, black where there are none."""
    rows = -(-len(images) // PER_ROW)
    padded = np.zeros((rows * PER_ROW, SIDE, SIDE, 3), np.uint8)
    padded[: len(images)] = images
    return padded.reshape(rows, PER_ROW, SIDE, SIDE, 3).swapaxes(1, 2).reshape(rows * SIDE, PER_ROW * SIDE, 3)


def pictures(pixels: UInt8[Array, "row column 3"]) -> UInt8[Array, "place 100 100 3"]:
    """Return the pictures of a contact sheet, the black ones at its end included."""
    rows = len(pixels) // SIDE
    return np.ascontiguousarray(pixels.reshape(rows, SIDE, PER_ROW, SIDE, 3).swapaxes(1, 2)).reshape(-1, SIDE, SIDE, 3)
