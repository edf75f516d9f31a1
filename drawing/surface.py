"""Table tops: a metre of wood, linen, stone or laminate.

A camera pixel covers a centimetre of table: grain, weave and crystals are finer than that, so little of their
contrast is left. What remains is broad and faint.
"""

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from drawing.shading import FINE, mix, noise, plain, smoothstep

Colour = tuple[float, float, float]
SURFACE_SIDE = FINE // 2


def surface(seed: int, kind: str, light: Colour, dark: Colour) -> UInt8[Array, "side side 3"]:
    """A table top of `kind` between two colours; ValueError if the kind is unknown."""
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
    elif kind == "marble":
        vein = np.abs(noise(rng, 0.10, 0.06) + 0.25 * noise(rng, 0.02, 0.02))
        share = 0.75 * (1 - smoothstep(0.0, 0.22, vein)) + 0.08 * noise(rng, 0.08, 0.08)
    elif kind == "laminate":
        share = 0.4 + 0.05 * noise(rng, 0.15, 0.15) + 0.05 * noise(rng, 0.002, 0.002)
    else:
        raise ValueError(f"unknown table top {kind!r}")
    colour = mix(plain(light), dark, np.clip(share, 0, 1))
    small = colour.reshape(SURFACE_SIDE, 2, SURFACE_SIDE, 2, 3).mean((1, 3))
    return np.rint(np.clip(small, 0, 1) * 255).astype(np.uint8)
