"""The canvas on which a scene is drawn, and the camera above it.

The canvas is finer than the camera's picture, and wider than the table. The camera adds perspective, blur, glare, tone,
noise and JPEG artefacts.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray as Array

from pipeline.world.layout import SIDE

SAMPLES = 2  # samples per pixel along each axis
PX_PER_M = SIDE * SAMPLES
CANVAS_M = 1.08  # side of the drawn table [m]: the camera's perspective stays within it
CANVAS = round(CANVAS_M * PX_PER_M)  # [pixels]
Window = tuple[slice, slice]  # rows and columns of the canvas
Plane = Float32[Array, "side side"]
Picture = Float32[Array, "side side 3"]
MIN_COVER = 62  # share [1 / 255] from which a pixel is an item's: a quarter, as handles are thinner than pixels


def axes() -> tuple[Array, Array]:
    """Return x and y from -0.5 to 0.5 along the canvas, as a row and a column."""
    along = np.linspace(-0.5, 0.5, CANVAS, dtype=np.float32)
    return along[None, :], along[:, None]


class Camera(NamedTuple):
    """A camera: where it sees the table, its blur, noise, gamma and JPEG quality."""

    view: Array  # homography from its finer picture to the canvas
    blur: float  # [fine pixels]
    noise: float
    shot: float  # noise that grows with the square root of the light
    gamma: float
    shoulder: bool  # whether highlights are compressed, as on film, or clipped
    jpeg: int | None
    glare: Plane | None

    def take(self, rng: np.random.Generator, canvas: Array) -> UInt8[Array, "100 100 3"]:
        """Return the picture of a canvas."""
        side = SIDE * SAMPLES
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(
            canvas.astype(np.float32), self.view, (side, side), flags=flags, borderMode=cv2.BORDER_REFLECT
        )
        if self.blur > 0.3:
            seen = cv2.GaussianBlur(seen, (0, 0), self.blur)
        picture = cv2.resize(seen, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
        if self.glare is not None:
            picture = picture + self.glare[..., None]
        picture = np.clip(picture, 0, None) ** np.float32(self.gamma)
        if self.shoulder:
            picture = 1.05 * (1 - np.exp(-1.5 * picture))
        spread = self.noise + self.shot * np.sqrt(np.clip(picture, 0, 1))
        picture = picture + rng.standard_normal(picture.shape, np.float32) * spread
        picture = np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)
        if self.jpeg is not None:
            coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])[1]
            picture = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
        return picture

    def label(self, labels: UInt8[Array, "side side"], count: int) -> UInt8[Array, "100 100"]:
        """Return the item that covers most of each pixel, at least a quarter; 0 for the table."""
        side = SIDE * SAMPLES
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(labels, self.view, (side, side), flags=flags, borderMode=cv2.BORDER_REFLECT)
        result, best = np.zeros((SIDE, SIDE), np.uint8), np.full((SIDE, SIDE), MIN_COVER, np.uint8)
        number = 0
        for k in range(1, count + 1):
            share = cv2.resize(
                np.where(seen == k, np.uint8(255), np.uint8(0)), (SIDE, SIDE), interpolation=cv2.INTER_AREA
            )
            if (larger := share > best).any():
                number += 1
                result[larger], best[larger] = number, share[larger]
        return result


def draw_camera(rng: np.random.Generator) -> Camera:
    """Draw a camera above the table, tilted by up to a few degrees."""
    margin, side = (CANVAS_M - 1) / 2, SIDE * SAMPLES
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    tilt = rng.uniform(-1, 1, (4, 2)) * margin * rng.choice([0.0, 0.3, 1.0])
    corners = (square + margin + tilt) * PX_PER_M - 0.5
    view = cv2.getPerspectiveTransform(np.float32(square * side - 0.5), np.float32(corners))  # pyright: ignore
    glare = None
    if rng.random() < 0.25:
        along = np.linspace(-0.5, 0.5, SIDE, dtype=np.float32)
        centre, turn, width = rng.uniform(-0.6, 0.6, 2), rng.uniform(0, np.pi), rng.uniform(0.05, 0.5, 2)
        x, y = along[None, :] - np.float32(centre[0]), along[:, None] - np.float32(centre[1])
        u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        glare = (rng.uniform(0.05, 0.5) * np.exp(-((u / width[0]) ** 2) - (v / width[1]) ** 2)).astype(np.float32)
    return Camera(
        view,
        rng.uniform(0.3, 1.6) if rng.random() < 0.6 else 0.0,
        float(np.exp(rng.uniform(-7, -4))),
        rng.uniform(0, 0.15) ** 2,
        float(np.exp(rng.normal(0, 0.15))),
        rng.random() < 0.5,
        int(rng.integers(50, 96)) if rng.random() < 0.3 else None,
        glare,
    )
