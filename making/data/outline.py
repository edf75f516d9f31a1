"""Outlines seen from above, as a gauge r: 0 at the centre and 1 on the edge, replacing the distance from the centre.

Anything drawn as a function of r (a profile, a rim, a band of decoration) follows the outline. Every outline lies
inside its footprint, the disc or capsule that decides path validity, and almost fills it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array


@dataclass(frozen=True)
class Outline:
    """A gauge in units of the footprint's radius; the footprint's half-length along x is `stretch` units."""

    gauge: Callable[[Array, Array], Array]
    stretch: float = 0.0  # 0: the footprint is a disc

    def __call__(self, x: Array, y: Array) -> Float[Array, "side side"]:
        """Return r at points of the cutout, on which the footprint's ends are at x = -1 and 1."""
        return self.gauge(x * (1 + self.stretch), y * (1 + self.stretch))


ROUND = Outline(np.hypot)


def oval(stretch: float) -> Outline:
    """Return the outline of the capsule, with a rim of constant width."""
    return Outline(lambda x, y: np.hypot(np.maximum(np.abs(x) - stretch, 0), y), stretch)


def polygon(corners: int, sharpness: float) -> Outline:
    """Return a polygon with corners on the unit circle, one at x = 1; sharpness 2: a circle, large: straight sides."""
    normals = (2 * np.arange(corners) + 1) * np.pi / corners

    def norm(x, y):
        return sum(np.maximum(x * np.cos(n) + y * np.sin(n), 0) ** sharpness for n in normals) ** (1 / sharpness)

    return Outline(lambda x, y: norm(x, y) / norm(1, 0))


def scalloped(lobes: int, depth: float) -> Outline:
    """Return an outline of lobes that meet in notches `depth` deep and vanish towards the centre."""

    def gauge(x, y):
        r = np.hypot(x, y)
        notch = 1 - np.abs(np.cos(lobes / 2 * np.arctan2(y, x)))
        return r / (1 - depth * np.minimum(r, 1) ** 2 * notch)

    return Outline(gauge)


def cut(facets: int) -> Outline:
    """Return a circle with shallow facets."""

    def gauge(x, y):
        r, bearing, sector = np.hypot(x, y), np.arctan2(y, x), np.pi / facets
        flat = r * np.cos((bearing + sector) % (2 * sector) - sector) / np.cos(sector) ** 0.5
        return np.maximum(flat, r * 0.97)

    return Outline(gauge)


def eared(stretch: float, ears: int, breadth: float) -> Outline:
    """Return a round body with a flat ear at both ends, or with one at the right end: a handle."""

    def gauge(x, y):
        body = np.hypot(x + stretch * (2 - ears), y)
        ear = np.hypot((np.abs(x) if ears == 2 else x) - stretch, y)
        ear = (ear**8 + np.abs(y / breadth) ** 8) ** (1 / 8)
        return np.minimum(body, np.maximum(ear, 0.94))

    return Outline(gauge, stretch)


def spouted(stretch: float) -> Outline:
    """Return a round body with a pouring lip at the right end."""

    def gauge(x, y):
        x = x + stretch
        return np.hypot(x, y) / (1 + 2 * stretch * np.exp(-((np.arctan2(y, x) / 0.42) ** 2)))

    return Outline(gauge, stretch)
