"""Draw table tops: a metre of wood, linen, stone or laminate, and patterns that no table of the experiment has.

A camera pixel covers a centimetre of table. Grain, weave and crystals are finer, so most of their contrast is lost;
only broad, faint structure remains.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

from making.data.shading import FINE, mix, noise, plain, smoothstep

Colour = tuple[float, float, float]
SURFACE_SIDE = FINE // 2  # side of a table top's image [px]
PATTERNS = ("veins", "stripes", "tiles", "checks", "cracks")  # that unseen tops may have


def surface(seed: int | Sequence[int], kind: str, light: Colour, dark: Colour) -> UInt8[Array, "side side 3"]:
    """Draw a table top of `kind` between two colours; ValueError for an unknown kind.

    The size and contrast of one of the PATTERNS are drawn at random as well.
    """
    rng = np.random.default_rng(seed)
    if kind == "wood":
        rings = np.sin(9 * noise(rng, 0.30, 0.02) + 2 * noise(rng, 0.2, 0.2))
        share = 0.5 + 0.12 * rings + 0.06 * noise(rng, 0.06, 0.002)
    elif kind == "planks":
        board = (np.arange(FINE) * 6 // FINE)[None, :] * np.ones((FINE, 1))
        tone = rng.uniform(-0.15, 0.15, 6)[board.astype(int)]
        seam = np.abs((np.arange(FINE) * 6 / FINE) % 1 - 0.5)[None, :] > 0.49
        share = 0.45 + tone + 0.05 * noise(rng, 0.12, 0.003) + 0.25 * seam
    elif kind == "linen":
        share = 0.5 + 0.08 * noise(rng, 0.002, 0.03) + 0.08 * noise(rng, 0.03, 0.002) + 0.04 * noise(rng, 0.1, 0.1)
    elif kind == "stone":
        share = 0.5 + 0.08 * noise(rng, 0.1, 0.1) + 0.05 * noise(rng, 0.012, 0.012) + 0.06 * noise(rng, 0.003, 0.003)
    elif kind == "laminate":
        share = 0.4 + 0.05 * noise(rng, 0.15, 0.15) + 0.05 * noise(rng, 0.002, 0.002)
    elif kind in PATTERNS:
        share = _pattern(rng, kind)
    else:
        raise ValueError(f"unknown table top {kind!r}")
    colour = mix(plain(light), dark, np.clip(share, 0, 1))
    small = colour.reshape(SURFACE_SIDE, 2, SURFACE_SIDE, 2, 3).mean((1, 3))
    return np.rint(np.clip(small, 0, 1) * 255).astype(np.uint8)


def _pattern(rng: np.random.Generator, kind: str) -> Float[Array, "side side"]:
    """Return the share of the dark colour on a table top with one of the PATTERNS."""
    (y, x), between = (np.mgrid[:FINE, :FINE] + 0.5) / FINE, rng.uniform

    def cloud(scale: float, across: float | None = None) -> Float[Array, "side side"]:
        return noise(rng, scale, across or scale)

    def band(across: Array, period: float, share: float) -> Array:
        return (across / period % 1 < share).astype(float)

    if kind == "veins":
        vein = np.abs(cloud(between(0.06, 0.16), between(0.04, 0.1)) + between(0.1, 0.35) * cloud(0.02))
        return between(0.4, 0.9) * (1 - smoothstep(0, between(0.08, 0.3), vein)) + 0.08 * cloud(0.08)
    if kind == "stripes":
        return 0.3 + between(0.1, 0.4) * band(x, between(0.05, 0.25), between(0.15, 0.5)) + 0.03 * cloud(0.003)
    if kind == "cracks":
        crack = np.abs(cloud(0.08) + 0.3 * cloud(0.015))
        return 0.3 + between(0.3, 0.7) * (1 - smoothstep(0, between(0.03, 0.08), crack)) + 0.05 * cloud(0.05)
    if kind == "checks":
        period = between(0.06, 0.2)
        return between(0.3, 1) * (0.2 + 0.3 * band(x, period, 0.5) + 0.3 * band(y, period, 0.5)) + 0.03 * cloud(0.003)
    period, joint = between(0.1, 0.3), between(0.006, 0.014)  # tiles
    tone = rng.uniform(-0.2, 0.2, (10, 10))[(y / period).astype(int), (x / period).astype(int)]
    joints = np.maximum(band(x, period, joint / period), band(y, period, joint / period))
    return 0.3 + between(0, 1) * tone + between(0.3, 0.7) * joints + 0.04 * cloud(0.1)
