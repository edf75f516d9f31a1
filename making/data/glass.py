"""Draw drinking glasses from above: the table shows through; rim, base and caustic are visible."""

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from making.data.outline import ROUND, Outline
from making.data.shading import finish, grid, inside, mix, plain, smoothstep

Colour = tuple[float, float, float]


def glass(
    tint: Colour, body: float, base: float, thick: float, outline: Outline = ROUND, mouth: float = 1.0
) -> UInt8[Array, "side side 4"]:
    """Draw a tumbler (wall's opacity, foot's radius, rim's thickness), or a wine glass with a narrow mouth."""
    x, y = grid()
    r, bearing = outline(x, y), np.arctan2(y, x)
    rim = _ring(r, 0.975 * mouth - thick / 2, thick)
    inner = _ring(r, 0.965 * mouth - 1.7 * thick, 0.35 * thick)
    foot = _ring(r, base, 0.035)
    wall = smoothstep(base, 0.95, r)
    alpha = body * (0.75 + 0.85 * wall) + 0.60 * rim + 0.25 * inner + 0.32 * foot
    colour = plain(tint) * (0.78 + 0.30 * wall)[..., None]
    colour = mix(colour, (0.16, 0.20, 0.22), 0.55 * _ring(r, 0.975 * mouth - 1.25 * thick, 0.4 * thick) + 0.25 * foot)
    lit = _arc(bearing, 2.2, 0.75) * rim + 0.8 * _arc(bearing, -0.9, 0.5) * inner
    lit += 0.55 * np.exp(-(((np.hypot(x + 0.22, y - 0.26)) / 0.16) ** 2))
    caustic = 0.35 * _arc(bearing, -0.8, 0.9) * _ring(r, 0.62 * base, 0.10)
    lit = np.clip(lit + caustic, 0, 1)
    colour = mix(colour, (1.0, 1.0, 1.0), 0.9 * lit)
    alpha = np.clip(alpha + 0.45 * lit, 0, 0.92) * inside(r - 0.99)
    return finish(colour, alpha)


def _ring(r: Array, radius: float, width: float) -> Array:
    return np.exp(-(((r - radius) / width) ** 2))


def _arc(bearing: Array, centre: float, half: float) -> Array:
    away = np.abs((bearing - centre + np.pi) % (2 * np.pi) - np.pi)
    return 1 - smoothstep(half * 0.4, half, away)
