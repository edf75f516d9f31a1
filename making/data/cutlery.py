"""Draw forks, knives and spoons lying along x: silhouettes, rounded metal, handles of several materials."""

from collections.abc import Callable

import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt

from making.data.shading import FINE, finish, grid, mix, noise, plain, smoothstep

Colour = tuple[float, float, float]
HALF_WIDTH = 0.013  # half-width of every piece at its widest [m]
STEEL, GOLD = (0.72, 0.73, 0.75), (0.80, 0.66, 0.36)  # RGB [1 = white]


def cutlery(
    seed: int, kind: str, length: float, metal: Colour, handle: Colour | None, slim: float
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


def _spoon(s: Array, slim: float) -> Array:
    return np.maximum(_handle(s, slim) * (s < 0.8), _oval(s, 0.845, 0.150))


def _fork(s: Array, slim: float) -> Array:
    head = smoothstep(0.62, 0.74, s) * (0.95 - 0.22 * smoothstep(0.8, 1.0, s)) * (s < 0.995)
    return np.maximum(_handle(s, slim) * (s < 0.75), head)


def _knife(s: Array, slim: float) -> Array:
    blade = smoothstep(0.50, 0.54, s) * np.sqrt(np.clip((0.995 - s) / 0.12, 0, 1).clip(0, 1))
    return np.maximum(_handle(s, slim) * (s < 0.55), 0.80 * blade)


def _cake_fork(s: Array, slim: float) -> Array:
    """Return the profile of a broad head from the middle on."""
    return np.maximum(_handle(s, slim) * (s < 0.6), smoothstep(0.52, 0.60, s) * _ends(s))


def _spreader(s: Array, slim: float) -> Array:
    """Return the profile of a broad blade with a round tip on a short handle."""
    return np.maximum(_handle(s, slim) * (s < 0.45), smoothstep(0.36, 0.46, s) * _ends(s, 0.14))


def _server(s: Array, slim: float) -> Array:
    """Return the profile of a leaf, broadest in its middle and pointed."""
    return np.maximum(_handle(s, slim) * (s < 0.6), np.sin(np.pi * ((s - 0.44) / 0.56).clip(0, 1)) ** 0.8)


def _ladle(s: Array, slim: float) -> Array:
    """Return the profile of a round head on a long thin rod."""
    return np.maximum(slim * _ends(s) * (s < 0.9), _oval(s, 0.92, 0.08))


def _pair(s: Array, slim: float) -> Array:
    """Return the profile of two sticks side by side, slightly closer at their tips, without the slot between them."""
    return _ends(s) * (1 - (1 - slim) * s)


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


def _none(s: Array, across: Array) -> Array:
    return np.zeros(s.shape, dtype=bool)


BLADES = ("knife", "spreader", "server")
PIECES = {  # profile, holes, and hollow part: centre and half-length as shares of the length
    "spoon": (_spoon, _none, (0.845, 0.13)),
    "fork": (_fork, _tines(3, 0.76), None),
    "knife": (_knife, _none, None),
    "spork": (_spoon, _tines(2, 0.90), (0.845, 0.13)),
    "cake fork": (_cake_fork, _gap(0.22, 0.70), None),
    "fish fork": (_server, _tines(2, 0.70), None),
    "spreader": (_spreader, _none, None),
    "server": (_server, _none, None),
    "ladle": (_ladle, _none, (0.92, 0.075)),
    "chopsticks": (_pair, _gap(0.38, 0.0), None),
    "tongs": (_pair, _gap(0.50, 0.10), None),
}
