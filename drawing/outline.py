"""Outlines seen from above: a gauge r, 0 in the middle and 1 on the edge, in place of the distance to the centre.

What is drawn as a function of r (a profile, a rim, a band of decoration) then follows the outline. Every outline
lies inside its footprint, the disc or capsule that decides whether a path is valid, and all but fills it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


@dataclass(frozen=True)
class Outline:
    """A gauge whose unit is the footprint's radius; the footprint's half-length along x is `stretch` such units."""

    gauge: Callable[[Array, Array], Array]
    stretch: float = 0.0  # 0: the footprint is a disc

    def __call__(self, x: Array, y: Array) -> Float[Array, "side side"]:
        """r at points of the cutout, on which the footprint's ends are at x = -1 and 1."""
        return self.gauge(x * (1 + self.stretch), y * (1 + self.stretch))


ROUND = Outline(np.hypot)


def oval(stretch: float) -> Outline:
    """The capsule itself, its rim as broad along the sides as round the ends."""
    return Outline(lambda x, y: np.hypot(np.maximum(np.abs(x) - stretch, 0), y), stretch)


def polygon(corners: int, sharpness: float) -> Outline:
    """Corners on the unit circle, one at x = 1: a circle at sharpness 2 (if even), straight sides far beyond."""
    normals = (2 * np.arange(corners) + 1) * np.pi / corners

    def norm(x, y):
        return sum(np.maximum(x * np.cos(n) + y * np.sin(n), 0) ** sharpness for n in normals) ** (1 / sharpness)

    return Outline(lambda x, y: norm(x, y) / norm(1, 0))


def scalloped(lobes: int, depth: float) -> Outline:
    """Lobes that meet in notches `depth` deep, and run out towards the middle."""

    def gauge(x, y):
        r = np.hypot(x, y)
        notch = 1 - np.abs(np.cos(lobes / 2 * np.arctan2(y, x)))
        return r / (1 - depth * np.minimum(r, 1) ** 2 * notch)

    return Outline(gauge)


def cut(facets: int) -> Outline:
    """A circle with shallow facets ground into it."""

    def gauge(x, y):
        r, bearing, sector = np.hypot(x, y), np.arctan2(y, x), np.pi / facets
        flat = r * np.cos((bearing + sector) % (2 * sector) - sector) / np.cos(sector) ** 0.5
        return np.maximum(flat, r * 0.97)

    return Outline(gauge)


def eared(stretch: float, ears: int, breadth: float) -> Outline:
    """A round body with a flat ear at either end, or with one at the right end: a handle."""

    def gauge(x, y):
        body = np.hypot(x + stretch * (2 - ears), y)
        ear = np.hypot((np.abs(x) if ears == 2 else x) - stretch, y)
        ear = (ear**8 + np.abs(y / breadth) ** 8) ** (1 / 8)
        return np.minimum(body, np.maximum(ear, 0.94))

    return Outline(gauge, stretch)


def spouted(stretch: float) -> Outline:
    """A round body drawn out into a pouring lip at the right end."""

    def gauge(x, y):
        x = x + stretch
        return np.hypot(x, y) / (1 + 2 * stretch * np.exp(-((np.arctan2(y, x) / 0.42) ** 2)))

    return Outline(gauge, stretch)
