"""Fields and colours from which the families of table tops are painted.

A top is a square of `side` pixels that shows SIDE_M metres, as float32 RGB [1 = white].
"""

import colorsys
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray as Array
from numpy.typing import ArrayLike

SIDE_M = 1.2  # side of a painted top [m]; the camera sees 1 m of it

Rng = np.random.Generator
Number = float | int  # the tests' beartype takes no int for a float
Range = tuple[Number, Number]
Field = Float32[Array, "side side"]
Top = Float32[Array, "side side 3"]
Colour = Float32[Array, "3"]
Sheet = UInt8[Array, "side side 3"]
FRACTION_BITS = 4


def colour(rng: Rng, hue: Range = (0, 1), saturation: Range = (0, 0.8), value: Range = (0.1, 0.95)) -> Colour:
    """Draw a colour, uniform in hue and value; dull ones are more frequent than saturated ones."""
    h, v = rng.uniform(*hue) % 1, rng.uniform(*value)
    s = saturation[0] + (saturation[1] - saturation[0]) * rng.random() ** 1.6
    return np.array(colorsys.hsv_to_rgb(h, s, v), np.float32)


def wood(rng: Rng) -> Colour:
    """Draw the colour of a wood, from ash to ebony."""
    return colour(rng, (0.03, 0.12), (0.2, 0.7), (0.25, 0.92))


def stone(rng: Rng) -> Colour:
    """Draw the colour of a stone, mostly grey."""
    return colour(rng, (0, 1), (0, 0.12), (0.12, 0.95)) if rng.random() < 0.7 else colour(rng, saturation=(0.1, 0.5))


def cloth(rng: Rng) -> Colour:
    """Draw the colour of a cloth: white, natural or dyed."""
    if rng.random() < 0.35:
        return colour(rng, (0.05, 0.15), (0, 0.25), (0.65, 0.97))
    return colour(rng, saturation=(0.1, 0.9), value=(0.15, 0.95))


def near(rng: Rng, base: Colour, spread: float) -> Colour:
    """Draw a colour near `base`: another brightness and, less so, another tint."""
    gain = rng.uniform(1 - 2 * spread, 1 + 2 * spread) * rng.normal(1, spread / 4, 3)
    return np.clip(base * gain + rng.uniform(-spread, spread) / 3, 0.02, 1).astype(np.float32)


def shades(rng: Rng, least: int = 2, most: int = 5) -> list[Colour]:
    """Draw some colours: unrelated ones, or shades of one."""
    base = colour(rng)
    alike = rng.random() < 0.4
    return [near(rng, base, 0.2) if alike else colour(rng) for _ in range(rng.integers(least, most + 1))]


def noise(rng: Rng, side: int, cells: Number, levels: int = 1, gain: float = 0.5, stretch: Number = 1.0) -> Field:
    """Draw smooth noise of several octaves, with mean 0 and standard deviation 1.

    The coarsest octave has `cells` random values from top to bottom and `cells / stretch` from left to right: a large
    `stretch` gives streaks along x. Each further octave has twice as many, weighted by `gain`.
    """
    total = np.zeros((side, side), np.float32)
    for level in range(levels):
        grid = [min(max(round(cells * 2**level / s), 2), side) for s in (1.0, stretch)]
        values = rng.standard_normal((grid[0], grid[1]), np.float32) * np.float32(gain**level)
        total += cv2.resize(values, (side, side), interpolation=cv2.INTER_CUBIC)
    return (total - total.mean()) / max(float(total.std()), 1e-3)


def grid(side: int, repeats: Number = 1) -> tuple[Field, Field]:
    """Return the columns x and rows y of a square, each from 0 to `repeats`."""
    along = (np.arange(side, dtype=np.float32) + 0.5) / side * repeats
    return np.broadcast_to(along, (side, side)), np.broadcast_to(along[:, None], (side, side))


def step(distance: Array, width: float) -> Array:
    """Return 0 where `distance` is below 0 and 1 above `width`, linear between."""
    return np.clip(distance / np.float32(width), 0, 1)


def ramp(field: Array, colours: Sequence[Colour]) -> Float32[Array, "rows columns 3"]:
    """Map a field from 0 to 1 to colours, linear between those given."""
    table = cv2.resize(np.asarray(colours, np.float32)[:, None], (1, 256), interpolation=cv2.INTER_LINEAR)[:, 0]
    return table[np.clip(field * 255, 0, 255).astype(np.uint8)]


def blend(below: Array, above: Array, share: Array) -> Top:
    """Return `above` over `below`, by its share of each pixel."""
    return below + (above - below) * share[..., None]


def sheet(shade: Colour, side: int) -> Sheet:
    """Return an 8-bit picture of one colour; OpenCV draws smooth edges on no other."""
    return np.full((side, side, 3), ink(shade), np.uint8)


def ink(shade: Colour) -> list[float]:
    """Return a colour as OpenCV draws it on a sheet."""
    return (np.clip(shade, 0, 1) * 255).tolist()


def dried(drawn: Sheet) -> Top:
    """Return a sheet as a top."""
    return drawn.astype(np.float32) / np.float32(255)


def wet(top: Top) -> Sheet:
    """Return a top as a sheet to draw on."""
    return (np.clip(top, 0, 1) * 255).astype(np.uint8)


def points(places: ArrayLike | float) -> Array:
    """Return places [pixels] in OpenCV's fixed point with FRACTION_BITS bits."""
    return np.asarray(np.asarray(places) * 2**FRACTION_BITS, np.int32)


def bend(picture: Float[Array, "side side ..."], right: Field, down: Field) -> Float[Array, "side side ..."]:
    """Return a picture whose pixels are fetched from `right` and `down` [share of its side]; it is mirrored outside."""
    side = len(picture)
    columns, rows = np.meshgrid(np.arange(side, dtype=np.float32), np.arange(side, dtype=np.float32))
    columns, rows = columns + right * side, rows + down * side
    return cv2.remap(picture, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
