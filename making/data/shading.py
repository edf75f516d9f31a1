"""Shade a height field seen from above under an even sky: steep faces and hollows are darker."""

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
