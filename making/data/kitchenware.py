"""Draw kitchenware from above: bowls and plates, drinking glasses, and cutlery that lies along x."""

from collections.abc import Callable

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt

from making.data.shading import FINE, ROUND, Outline, finish, grid, inside, mix, noise, plain, sky_light, smoothstep

Colour = tuple[float, float, float]
HALF_WIDTH = 0.013  # half-width of every piece at its widest [m]
STEEL, GOLD = (0.72, 0.73, 0.75), (0.80, 0.66, 0.36)  # RGB [1 = white]


def bowl(
    seed: int, inner: Colour, rim: Colour, accent: Colour, pattern: str, wall: float, outline: Outline = ROUND
) -> UInt8[Array, "side side 4"]:
    """Draw a deep bowl: thick rim, inner wall falling over `wall` of the radius to a flat bottom."""
    x, y = grid()
    r = outline(x, y)
    lip = 0.90  # radius of the rim's crest
    bottom = lip - wall
    height = 0.62 * smoothstep(bottom * 0.55, lip, r) - 0.5 * smoothstep(lip, 1.02, r)
    painted = _painted(seed, plain(inner), accent, pattern, r, 0.3, lip - 0.07)
    colour = mix(painted, rim, smoothstep(lip - 0.07, lip - 0.04, r))
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
    """Return the decoration between gauge values `low` and `high` of `r`."""
    rng = np.random.default_rng(seed)
    x, y = grid()
    bearing = np.arctan2(y, x)
    band = smoothstep(low - 0.01, low + 0.01, r) * (1 - smoothstep(high - 0.01, high + 0.01, r))
    squares = np.sin(bearing * 14) * np.sin((r - low) * 2 * np.pi / 0.2)
    petal = np.abs(np.sin(bearing * 4)) * (high - low) * 0.9 - np.abs(r - (low + high) / 2) * 1.6
    middle, arc = (low + high) / 2, (bearing / (2 * np.pi) * 20) % 1 - 0.5
    shares = {
        "plain": lambda: 0 * r,
        "band": lambda: band * smoothstep(middle + 0.08, middle + 0.10, r),
        "rings": lambda: band * (0.5 + 0.5 * np.tanh(np.sin((r - low) * 2 * np.pi / 0.11) / 0.25)),
        "rays": lambda: band * (0.5 + 0.5 * np.tanh(np.sin(bearing * 18) / 0.3)),
        "petals": lambda: band * smoothstep(-0.012, 0.012, petal),
        "dots": lambda: 1 - smoothstep(0.035, 0.05, np.hypot(arc * 2 * np.pi * middle / 20, r - middle)),
        "checks": lambda: band * (0.5 + 0.5 * np.tanh(squares / 0.15)),
        "speckles": lambda: smoothstep(1.9, 2.2, noise(rng, 0.006, 0.006)),
        "glaze": lambda: np.clip(0.5 + 0.35 * noise(rng, 0.05, 0.05) + 0.8 * (r - 0.6), 0, 1),
        "spiral": lambda: band * (0.5 + 0.5 * np.tanh(np.sin(bearing * 3 + r * 22) / 0.3)),
    }
    return mix(colour, accent, shares[pattern]())


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


def cutlery(
    seed: int, length: float, kind: str, metal: Colour, handle: Colour | None, slim: float
) -> UInt8[Array, "side side 4"]:
    """Draw a piece of `length` [m]: `kind` one of PIECES; `handle` None for all metal."""
    x, y = grid()
    along, across = (x + 1) / 2 * length, y / 2 * length  # [m] from the handle's end, from the axis
    profile, hole, hollow = PIECES[kind]
    half = profile(along / length, slim) * HALF_WIDTH
    solid = (np.abs(across) < half) & ~hole(along / length, across / HALF_WIDTH)
    depth = distance_transform_edt(solid) * length / FINE  # distance from the nearest edge [m]
    alpha = np.clip(depth / (length / FINE), 0, 1)
    round_ = 1 - np.exp(-depth / 0.0022)  # rounded edge of the metal
    colour = plain(metal) * (0.52 + 0.48 * round_)[..., None]
    streak = np.exp(-(((across - 0.25 * half) / np.maximum(0.22 * half, 1e-4)) ** 2))
    colour += (0.34 * streak * round_)[..., None]
    if hollow is not None:
        centre, reach = hollow
        bowl = np.hypot((along / length - centre) / reach, across / HALF_WIDTH / 0.9)
        colour *= (1 - 0.34 * (1 - smoothstep(0.35, 0.95, bowl)))[..., None]
        colour += (0.25 * np.exp(-(((bowl - 0.55) / 0.18) ** 2)) * (across < 0))[..., None]
    if kind in BLADES:
        edge = smoothstep(0.45, 0.6, along / length) * (across < -0.35 * half)
        colour += 0.12 * edge[..., None]
    if handle is not None:
        grain = 0.06 * noise(np.random.default_rng(seed), 0.004, 0.08)
        material = plain(handle) * (0.62 + 0.38 * round_ + grain)[..., None]
        colour = mix(colour, material, 1 - smoothstep(0.50, 0.512, along / length))
    return finish(colour, alpha)


def _handle(s: Array, slim: float) -> Array:
    """Return the half-width of the handle over the first half and a neck after it [HALF_WIDTH]."""
    end = np.sqrt(np.clip(1 - ((0.06 - s) / 0.06).clip(0, 1) ** 2, 0, 1))
    return end * (slim + (0.22 - slim) * smoothstep(0.30, 0.60, s))


def _oval(s: Array, centre: float, half: float) -> Array:
    return np.sqrt(np.clip(1 - ((s - centre) / half) ** 2, 0, 1))


def _ends(s: Array, reach: float = 0.08) -> Array:
    """Return 1 except for round ends of length `reach`; with the default no piece leaves its capsule."""
    return _oval(np.maximum(np.abs(s - 0.5) - (0.5 - reach), 0), 0.0, reach)


def _headed(reach: float, head: Callable[[Array], Array]) -> Callable[[Array, float], Array]:
    """Return the profile of a head on a handle that ends within it, at `reach` of the length."""
    return lambda s, slim: np.maximum(_handle(s, slim) * (s < reach), head(s))


def _tines(gaps: int, start: float) -> Callable[[Array, Array], Array]:
    """Return the slots between the tines, from `start` of the length to the tip."""

    def hole(s: Array, across: Array) -> Array:
        pitch = 1.5 / (gaps + 1)
        centres = (np.arange(gaps) - (gaps - 1) / 2) * pitch
        nearest = np.min([np.abs(across - c) for c in centres], axis=0)
        return (nearest < 0.30 * pitch) & (s > start)

    return hole


def _gap(half: float, start: float) -> Callable[[Array, Array], Array]:
    """Return a broad slot, `half` of the half-width to either side of the axis, from `start` of the length on."""
    return lambda s, across: (np.abs(across) < half) & (s > start)


_NONE = _gap(0.0, 0.0)
_SPOON = _headed(0.8, lambda s: _oval(s, 0.845, 0.150))
_LEAF = _headed(0.6, lambda s: np.sin(np.pi * ((s - 0.44) / 0.56).clip(0, 1)) ** 0.8)  # pointed
_FORK = _headed(0.75, lambda s: smoothstep(0.62, 0.74, s) * (0.95 - 0.22 * smoothstep(0.8, 1.0, s)) * (s < 0.995))
_KNIFE = _headed(0.55, lambda s: 0.80 * (smoothstep(0.50, 0.54, s) * np.sqrt(np.clip((0.995 - s) / 0.12, 0, 1))))
BLADES = ("knife", "spreader", "server")
PIECES = {  # profile, holes, and hollow part: centre and half-length as shares of the length
    "spoon": (_SPOON, _NONE, (0.845, 0.13)),
    "fork": (_FORK, _tines(3, 0.76), None),
    "knife": (_KNIFE, _NONE, None),
    "spork": (_SPOON, _tines(2, 0.90), (0.845, 0.13)),
    "cake fork": (_headed(0.6, lambda s: smoothstep(0.52, 0.60, s) * _ends(s)), _gap(0.22, 0.70), None),
    "fish fork": (_LEAF, _tines(2, 0.70), None),
    "spreader": (_headed(0.45, lambda s: smoothstep(0.36, 0.46, s) * _ends(s, 0.14)), _NONE, None),
    "server": (_LEAF, _NONE, None),
    "ladle": (lambda s, slim: np.maximum(slim * _ends(s) * (s < 0.9), _oval(s, 0.92, 0.08)), _NONE, (0.92, 0.075)),
    "chopsticks": (lambda s, slim: _ends(s) * (1 - (1 - slim) * s), _gap(0.38, 0.0), None),
    "tongs": (lambda s, slim: _ends(s) * (1 - (1 - slim) * s), _gap(0.50, 0.10), None),
}
