"""The canvas on which a scene is drawn before the camera sees it: finer than its picture, and wider than the table."""

import numpy as np
from jaxtyping import Float32
from numpy import ndarray as Array

from pipeline.world.layout import SIDE

SAMPLES = 2  # samples per pixel along each axis
PX_PER_M = SIDE * SAMPLES
CANVAS_M = 1.08  # side of the drawn table [m]: the camera's perspective stays within it
CANVAS = round(CANVAS_M * PX_PER_M)  # [pixels]
Window = tuple[slice, slice]  # rows and columns of the canvas
Plane = Float32[Array, "side side"]
Picture = Float32[Array, "side side 3"]


def axes() -> tuple[Array, Array]:
    """Return x and y from -0.5 to 0.5 along the canvas, as a row and a column."""
    along = np.linspace(-0.5, 0.5, CANVAS, dtype=np.float32)
    return along[None, :], along[:, None]
