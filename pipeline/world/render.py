"""A scene's picture from above: 100 x 100 RGB of the 1 m table, row 0 at the far edge.

The light, the stretch of table top and the camera's noise come from the scene's render seed alone, never from the
items, so that one item more leaves every pixel away from it and its shadow exactly as it was.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray as Array
from scipy.ndimage import correlate1d, map_coordinates, shift

from pipeline.runtime.errors import InputError
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, Layouts

SAMPLES = 3  # samples per pixel and axis, averaged
REACH_M = 0.04  # how far beyond its footprint an item and its shadow are drawn; the lens spreads their edge by a pixel
BOWED = {"bowl": 0.16, "plate": 0.05, "cutlery": 0.0, "glass": 0.04}  # brighter away from the light: concave
SHADOW = {"bowl": 0.42, "plate": 0.34, "cutlery": 0.30, "glass": 0.13}  # share of the light an item takes away
HEIGHT_M = {"bowl": 0.016, "plate": 0.009, "cutlery": 0.005, "glass": 0.018}  # shift of the shadow
LAMP = ((0.35, 0.3), (0.7, 0.4), (1.0, 0.3))  # a lamp has a size: share of the shift and weight of each faint shadow
LENS = np.array([0.06, 0.88, 0.06], np.float32)  # the camera's blur along each axis


@dataclass(frozen=True)
class Light:
    """What the render seed decides of a scene: stretch of table top, light, and camera."""

    offset: Float[Array, "2"]  # of the table top's texture, in texture widths
    turn: float  # of the texture [rad]
    direction: Float[Array, "2"]  # unit vector on the table towards the light
    gain: Float32[Array, "3"]  # brightness and tint
    fall_off: float  # share of brightness lost from the lit edge of the table to the other
    vignette: float  # share of brightness lost in the corners
    noise: Float32[Array, "side side 3"]  # of the sensor, in grey levels of 0..1


def draw_light(seed: int) -> Light:
    """The look of the scene whose render seed is `seed`."""
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(-np.pi, np.pi)
    return Light(
        offset=rng.uniform(0.0, 1.0, 2),
        turn=rng.uniform(-np.pi, np.pi),
        direction=np.array([np.cos(bearing), np.sin(bearing)]),
        gain=(rng.uniform(0.86, 1.08) * rng.normal(1.0, 0.025, 3)).astype(np.float32),
        fall_off=rng.uniform(0.02, 0.12),
        vignette=rng.uniform(0.02, 0.10),
        noise=rng.standard_normal((SIDE, SIDE, 3), np.float32) * np.float32(rng.uniform(0.006, 0.016)),
    )


class Palette:
    """Pictures prepared for drawing: premultiplied mipmaps of the cutouts, table tops at the picture's scale."""

    def __init__(self, catalogue: Catalogue) -> None:
        items, textures = catalogue.items, catalogue.textures
        self.cutouts = [_mipmap(c, w) for c, w in zip(catalogue.cutouts, items["width_m"], strict=True)]
        self.surface_widths = dict(zip(textures["name"], textures["width_m"], strict=True))
        self.surfaces = {
            name: _shrink_to(surface.astype(np.float32) / 255, self.surface_widths[name], SIDE * 1.5)
            for name, surface in zip(textures["name"], catalogue.surfaces, strict=True)
        }


@lru_cache(maxsize=1)
def read_palette(data: str) -> tuple[Catalogue, Palette]:
    """The catalogue in a folder and its pictures prepared for drawing, read once per process."""
    catalogue = read_catalogue(Path(data))
    return catalogue, Palette(catalogue)


def render_scenes(
    layouts: Layouts, textures: Sequence[str], seeds: Sequence[int], palette: Palette
) -> UInt8[Array, "scene 100 100 3"]:
    """Pictures of the scenes, each on its texture and under the light of its render seed."""
    pictures = np.empty((len(layouts), SIDE, SIDE, 3), np.uint8)
    for scene, (texture, seed) in enumerate(zip(textures, seeds, strict=True)):
        pictures[scene] = render(layouts, scene, texture, int(seed), palette)
    return pictures


def render(layouts: Layouts, scene: int, texture: str, seed: int, palette: Palette) -> UInt8[Array, "100 100 3"]:
    """Picture of one scene; raises ValueError if the texture or an item is not in the palette."""
    if texture not in palette.surfaces:
        raise InputError(f"unknown texture {texture!r}: the catalogue has {sorted(palette.surfaces)}")
    light = draw_light(seed)
    picture = _table_top(light, palette.surfaces[texture], palette.surface_widths[texture])
    stamps = [_stamp(layouts, scene, int(slot), light, palette) for slot in np.flatnonzero(layouts.present[scene])]
    for stamp in stamps:
        stamp.shade(picture, light)
    for stamp in stamps:
        stamp.cover(picture)
    picture *= _illumination(light)
    for axis in (0, 1):
        picture = correlate1d(picture, LENS, axis=axis, mode="nearest")
    return np.rint(np.clip(picture + light.noise, 0, 1) * 255).astype(np.uint8)


def _pixel_centres(columns: Array, rows: Array) -> tuple[Array, Array]:
    """Table coordinates x, y [m] of (possibly fractional) pixel columns and rows."""
    return (columns + 0.5) / SIDE, 1.0 - (rows + 0.5) / SIDE


def _table_top(light: Light, surface: Array, width: float) -> Float32[Array, "side side 3"]:
    """The texture under a random turn and shift, repeated beyond its edges by reflection."""
    x, y = _pixel_centres(np.arange(SIDE)[None, :], np.arange(SIDE)[:, None])
    c, s = np.cos(light.turn), np.sin(light.turn)
    scale = np.array(surface.shape[:2]) / width
    rows = (s * (x - 0.5) + c * (y - 0.5)) * scale[0] + light.offset[0] * surface.shape[0]
    columns = (c * (x - 0.5) - s * (y - 0.5)) * scale[1] + light.offset[1] * surface.shape[1]
    where = np.stack([rows, columns])
    return np.stack([map_coordinates(surface[..., k], where, order=1, mode="reflect") for k in range(3)], axis=-1)


def _illumination(light: Light) -> Float32[Array, "side side 3"]:
    """Brightness over the table: gain and tint, less light far from the lamp, darker corners."""
    x, y = _pixel_centres(np.arange(SIDE)[None, :], np.arange(SIDE)[:, None])
    towards = (x - 0.5) * light.direction[0] + (y - 0.5) * light.direction[1]
    corner = ((x - 0.5) ** 2 + (y - 0.5) ** 2) / 0.5
    field = (1 + light.fall_off * towards) * (1 - light.vignette * corner)
    return field[..., None].astype(np.float32) * light.gain


@dataclass(frozen=True)
class _Stamp:
    """One item in its place: the window of the picture it touches, its premultiplied colour and alpha there."""

    rows: slice
    columns: slice
    rgba: Float32[Array, "rows columns 4"]
    symbol: str

    @cached_property
    def _alpha(self) -> Float32[Array, "rows columns"]:
        return self.rgba[..., 3]

    def shade(self, picture: Array, light: Light) -> None:
        """Darken the table by the soft shadow; a glass lets light through and gathers it in the middle."""
        height = HEIGHT_M[self.symbol] * SIDE
        solid = np.minimum(self._alpha * (4.0 if self.symbol == "glass" else 1.0), 1.0)
        shadow = np.zeros_like(solid)
        for reach, weight in LAMP:
            offset = (light.direction[1] * height * reach, -light.direction[0] * height * reach)
            shadow += weight * shift(solid, offset, order=1, mode="constant")
        kernel = np.array([0.25, 0.5, 0.25], np.float32)
        for axis in (0, 1):
            shadow = correlate1d(shadow, kernel, axis=axis, mode="constant")
        picture[self.rows, self.columns] *= 1 - SHADOW[self.symbol] * shadow[..., None]

    def cover(self, picture: Array) -> None:
        """Lay the item over the table (Porter and Duff's `over`)."""
        window = picture[self.rows, self.columns]
        window *= 1 - self.rgba[..., 3:]
        window += self.rgba[..., :3]


def _stamp(layouts: Layouts, scene: int, slot: int, light: Light, palette: Palette) -> _Stamp:
    """Turn, scale and place one item: samples on a grid of SAMPLES per pixel, averaged over each pixel."""
    index = int(layouts.item[scene, slot])
    if not 0 <= index < len(palette.cutouts):
        raise InputError(f"item {index} is not in the catalogue of {len(palette.cutouts)} items: rerun stage scenes")
    symbol = SYMBOLS[layouts.symbol[scene, slot]]
    centre, angle, scale = layouts.centre[scene, slot], layouts.angle[scene, slot], layouts.scale[scene, slot]
    levels, width = palette.cutouts[index].levels, palette.cutouts[index].width * scale
    half = np.abs([np.cos(angle), np.sin(angle)]) * layouts.half_length[scene, slot] + layouts.radius[scene, slot]
    half = half + REACH_M
    rows, columns = _window(centre, half)
    fine = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    sub_columns = (np.arange(columns.start, columns.stop)[:, None] + fine).ravel()[None, :]
    sub_rows = (np.arange(rows.start, rows.stop)[:, None] + fine).ravel()[:, None]
    x, y = _pixel_centres(sub_columns, sub_rows)
    dx, dy = x - centre[0], y - centre[1]
    c, s = np.cos(angle), np.sin(angle)
    level = next((m for m in reversed(levels) if len(m) >= width * SIDE * SAMPLES), levels[0])
    side = len(level)
    u = ((c * dx + s * dy) / width + 0.5) * side - 0.5
    v = (0.5 - (c * dy - s * dx) / width) * side - 0.5
    where = np.stack(np.broadcast_arrays(v, u))
    shape = (rows.stop - rows.start, SAMPLES, columns.stop - columns.start, SAMPLES)
    rgba = np.stack(
        [map_coordinates(level[..., k], where, order=1, mode="constant").reshape(shape).mean((1, 3)) for k in range(4)],
        axis=-1,
    )
    return _Stamp(rows, columns, _lit(rgba, rows, columns, centre, half - REACH_M, symbol, light), symbol)


def _window(centre: Array, half: Array) -> tuple[slice, slice]:
    """Rows and columns of the picture within `half` [m] of `centre`, clipped to the table."""
    column_low, column_high = np.floor((centre[0] + np.array([-half[0], half[0]])) * SIDE).astype(int)
    row_low, row_high = np.floor((1 - centre[1] + np.array([-half[1], half[1]])) * SIDE).astype(int)
    return (
        slice(max(row_low, 0), min(row_high + 1, SIDE)),
        slice(max(column_low, 0), min(column_high + 1, SIDE)),
    )


def _lit(rgba, rows, columns, centre, half, symbol, light) -> Float32[Array, "rows columns 4"]:
    """Directional light on the evenly lit cutout: concave things are brighter away from the light, edges catch it."""
    x, y = _pixel_centres(np.arange(columns.start, columns.stop)[None, :], np.arange(rows.start, rows.stop)[:, None])
    towards = ((x - centre[0]) * light.direction[0] + (y - centre[1]) * light.direction[1]) / half.max()
    alpha = rgba[..., 3]
    slope_rows, slope_columns = np.gradient(alpha)
    edge = slope_rows * light.direction[1] - slope_columns * light.direction[0]  # > 0: the edge faces the light
    shade = 1 - BOWED[symbol] * np.clip(towards, -1, 1) + 0.25 * edge
    lit = rgba.copy()
    lit[..., :3] = np.clip(rgba[..., :3] * shade[..., None], 0, alpha[..., None])
    return lit.astype(np.float32)


@dataclass(frozen=True)
class _Mipmap:
    """A cutout, premultiplied by its alpha and halved again and again."""

    levels: list[Array]  # float32 (side, side, 4), each half as fine as the one before
    width: float  # [m]


def _mipmap(cutout: Array, width: float) -> _Mipmap:
    level = cutout.astype(np.float32) / 255
    level[..., :3] *= level[..., 3:]
    levels = [level]
    while len(levels[-1]) >= 16:
        levels.append(_halved(levels[-1]))
    return _Mipmap(levels, width)


def _halved(a: Array) -> Array:
    rows, columns = a.shape[0] // 2, a.shape[1] // 2
    return a[: 2 * rows, : 2 * columns].reshape(rows, 2, columns, 2, -1).mean((1, 3))


def _shrink_to(surface: Array, width: float, per_metre: float) -> Array:
    """Halve the texture while it stays finer than `per_metre` pixels a metre."""
    while surface.shape[1] / 2 / width >= per_metre:
        surface = _halved(surface)
    return surface
