"""Outlines of items seen from above, and the shading of a height field under an even sky.

An outline is a gauge r: 0 at the centre and 1 on the edge, replacing the distance from the centre. Anything drawn as a
function of r (a profile, a rim, a band of decoration) follows it. Every outline lies inside its footprint, the disc or
capsule that decides path validity, and almost fills it. Steep faces and hollows are darker.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.ndimage import gaussian_filter

SIDE = 320  # side of a finished cutout [px]
FINE = 2 * SIDE  # side while drawing [px], averaged afterwards


def grid() -> tuple[Float[Array, "side side"], Float[Array, "side side"]]:
    """Return x to the right and y up, each from -1 to 1 over the cutout."""
    axis = (np.arange(FINE) + 0.5) / FINE * 2 - 1
    return np.broadcast_to(axis, (FINE, FINE)), np.broadcast_to(-axis[:, None], (FINE, FINE))


def inside(distance: Float[Array, "side side"]) -> Float[Array, "side side"]:
    """Return the coverage of the shape with this signed distance (negative inside), with an edge one pixel soft."""
    return np.clip(0.5 - distance * FINE / 4, 0.0, 1.0)


def smoothstep(low: float, high: float, x: Array) -> Array:
    """Return 0 below `low`, 1 above `high`, and a smooth transition between."""
    t = np.clip((x - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def sky_light(height: Float[Array, "side side"], hollow: float = 0.35) -> Float[Array, "side side"]:
    """Return the brightness, about 1, of a surface of this height (in half-widths), darkened by slope and occlusion."""
    slope_y, slope_x = np.gradient(height, 2 / FINE)
    facing = 1 / np.sqrt(1 + slope_x**2 + slope_y**2)
    around = gaussian_filter(height, FINE / 14, mode="nearest")
    return (0.5 + 0.5 * facing) * (1 + hollow * np.clip(height - around, -0.6, 0.15) * 2.2)


def noise(rng: np.random.Generator, *scales: float) -> Float[Array, "side side"]:
    """Smooth noise of standard deviation 1, blurred by `scales` (down, across) of the side."""
    field = gaussian_filter(rng.standard_normal((FINE, FINE)), [s * FINE for s in scales], mode="wrap")
    return field / field.std()


def mix(a: Array, b: Array | tuple, share: Array) -> Array:
    """Return colour `a` mixed with colour `b` by `share` in [0, 1]."""
    return a + (np.asarray(b) - a) * share[..., None]


def plain(colour: tuple[float, float, float]) -> Float[Array, "side side 3"]:
    """Return an image of one colour."""
    return np.broadcast_to(np.asarray(colour, dtype=float), (FINE, FINE, 3)).copy()


def finish(colour: Float[Array, "side side 3"], alpha: Float[Array, "side side"]) -> Array:
    """Return 8-bit RGBA with straight alpha, averaged down to SIDE; fully transparent pixels are black."""
    premultiplied = np.clip(colour, 0, 1) * alpha[..., None]
    small = np.concatenate([premultiplied, alpha[..., None]], axis=-1)
    small = small.reshape(SIDE, 2, SIDE, 2, 4).mean((1, 3))
    opacity = np.maximum(small[..., 3:], 1e-6)
    rgba = np.concatenate([small[..., :3] / opacity, small[..., 3:]], axis=-1)
    rgba[small[..., 3] < 1 / 512] = 0
    return np.rint(np.clip(rgba, 0, 1) * 255).astype(np.uint8)


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
