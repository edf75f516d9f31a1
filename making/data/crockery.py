"""Draw bowls and plates: turned profiles with painted decoration."""

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from making.data.outline import ROUND, Outline
from making.data.shading import finish, grid, inside, mix, noise, plain, sky_light, smoothstep

Colour = tuple[float, float, float]


def bowl(
    seed: int, inner: Colour, rim: Colour, accent: Colour, pattern: str, wall: float, outline: Outline = ROUND
) -> UInt8[Array, "side side 4"]:
    """Draw a deep bowl: thick rim, inner wall falling over `wall` of the radius to a flat bottom."""
    x, y = grid()
    r = outline(x, y)
    lip = 0.90  # radius of the rim's crest
    bottom = lip - wall
    height = 0.62 * smoothstep(bottom * 0.55, lip, r) - 0.5 * smoothstep(lip, 1.02, r)
    colour = mix(
        _painted(seed, plain(inner), accent, pattern, r, 0.3, lip - 0.07), rim, smoothstep(lip - 0.07, lip - 0.04, r)
    )
    depth = 0.58 + 0.42 * smoothstep(0.1, lip, r)  # less sky light reaches the bottom
    crest = 0.22 * np.exp(-(((r - lip) / 0.03) ** 2))
    colour = colour * (sky_light(height) * depth + crest)[..., None]
    colour += 0.16 * _gloss(x, y, 0.18, 0.30, 0.16)[..., None]
    return finish(colour, inside(r - 0.995))


def plate(
    seed: int, base: Colour, accent: Colour, pattern: str, well: float, outline: Outline = ROUND
) -> UInt8[Array, "side side 4"]:
    """Draw a flat plate: a broad rim outside a shallow well of radius `well`."""
    x, y = grid()
    r = outline(x, y)
    height = 0.10 * smoothstep(well - 0.05, well + 0.06, r) + 0.05 * smoothstep(well, 1.0, r)
    height = height - 0.12 * smoothstep(0.965, 1.02, r)
    colour = _painted(seed, plain(base), accent, pattern, r, well + 0.08, 0.97)
    edge = 0.10 * np.exp(-(((r - 0.96) / 0.015) ** 2)) - 0.16 * np.exp(-(((r - well) / 0.028) ** 2))
    colour = colour * (sky_light(height, 0.5) + edge)[..., None]
    colour += 0.08 * _gloss(x, y, -0.25, 0.28, 0.24)[..., None]
    return finish(colour, inside(r - 0.995))


def _gloss(x: Array, y: Array, x0: float, y0: float, size: float) -> Array:
    """Return the reflection of a soft window in the glaze."""
    return np.exp(-((((x - x0) / size) ** 2 + ((y - y0) / (0.6 * size)) ** 2) ** 2))


def _painted(seed: int, colour: Array, accent: Colour, pattern: str, r: Array, low: float, high: float) -> Array:
    """Return the decoration between gauge values `low` and `high` of `r`; ValueError for an unknown pattern."""
    rng = np.random.default_rng(seed)
    x, y = grid()
    bearing = np.arctan2(y, x)
    band = smoothstep(low - 0.01, low + 0.01, r) * (1 - smoothstep(high - 0.01, high + 0.01, r))
    middle, arc = (low + high) / 2, (bearing / (2 * np.pi) * 20) % 1 - 0.5
    petal = np.abs(np.sin(bearing * 4)) * (high - low) * 0.9 - np.abs(r - middle) * 1.6
    shares = {
        "plain": lambda: 0 * r,
        "band": lambda: band * smoothstep(middle + 0.08, middle + 0.10, r),
        "rings": lambda: band * (0.5 + 0.5 * np.tanh(np.sin((r - low) * 2 * np.pi / 0.11) / 0.25)),
        "rays": lambda: band * (0.5 + 0.5 * np.tanh(np.sin(bearing * 18) / 0.3)),
        "petals": lambda: band * smoothstep(-0.012, 0.012, petal),
        "dots": lambda: 1 - smoothstep(0.035, 0.05, np.hypot(arc * 2 * np.pi * middle / 20, r - middle)),
        "checks": lambda: (
            band * (0.5 + 0.5 * np.tanh(np.sin(bearing * 14) * np.sin((r - low) * 2 * np.pi / 0.2) / 0.15))
        ),
        "speckles": lambda: smoothstep(1.9, 2.2, noise(rng, 0.006, 0.006)),
        "glaze": lambda: np.clip(0.5 + 0.35 * noise(rng, 0.05, 0.05) + 0.8 * (r - 0.6), 0, 1),
        "spiral": lambda: band * (0.5 + 0.5 * np.tanh(np.sin(bearing * 3 + r * 22) / 0.3)),
    }
    if pattern not in shares:
        raise ValueError(f"unknown pattern {pattern!r}")
    return mix(colour, accent, shares[pattern]())
