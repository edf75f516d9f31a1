"""Render a scene from above with OpenCV: 100 x 100 RGB of the 1 m table, row 0 at the far edge.

The light, the stretch of table top and the camera's noise come from the scene's render seed alone, never from the
items. So an added item leaves every pixel away from it and its shadow exactly as it was.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import SIDE, Layouts
from pipeline.world.symbols import TABLE, Symbol

SAMPLES = 3  # samples per pixel and axis, averaged
REACH_M = 0.04  # how far beyond its footprint an item and its shadow are drawn; the lens spreads their edge by a pixel
LAMP = ((0.35, 0.3), (0.7, 0.4), (1.0, 0.3))  # a lamp has a size: share of the shift and weight of each faint shadow
SHADOW_BLUR = np.array([0.25, 0.5, 0.25], np.float32)  # along each axis
RIM_SHADOW = 4.0  # a transparent item's alpha counts this many times, at most 1, for its shadow
EDGE_LIGHT = 0.25  # brightness that an edge gains when it faces the lamp
LENS = np.array([0.06, 0.88, 0.06], np.float32)  # the camera's blur along each axis
MIN_MIPMAP_PX = 16  # a cutout is not halved below this side
TEXTURE_PX_PER_M = 150.0  # a texture is halved while it stays at least this fine

_LINEAR = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP  # matrices map image to source


@dataclass(frozen=True)
class Light:
    """What the render seed decides of a scene: stretch of table top, light, and camera."""

    offset: Float[Array, "2"]  # of the table top's texture, in texture widths
    turn: float  # of the texture [rad]
    direction: Float[Array, "2"]  # unit vector on the table towards the lamp
    gain: Float32[Array, "3"]  # brightness and tint
    fall_off: float  # share of brightness lost from the lit edge of the table to the other
    vignette: float  # share of brightness lost in the corners
    noise: Float32[Array, "side side 3"]  # of the sensor, in grey levels of 0..1


def draw_light(seed: int) -> Light:
    """Draw the light and the camera of the scene whose render seed is `seed`."""
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
    """Images prepared for rendering: premultiplied mipmaps of the cutouts, table tops at the scene's scale."""

    def __init__(self, catalogue: Catalogue) -> None:
        items, textures = catalogue.items, catalogue.textures
        self.mipmaps = [_mipmap(cutout) for cutout in catalogue.cutouts]  # by item
        self.item_widths = items["width_m"].to_numpy(float)
        self.surface_widths = dict(zip(textures["name"], textures["width_m"], strict=True))
        self.surfaces = {
            name: _shrink(surface.astype(np.float32) / 255, self.surface_widths[name])
            for name, surface in zip(textures["name"], catalogue.surfaces, strict=True)
        }


@lru_cache(maxsize=1)
def read_palette(data: str) -> tuple[Catalogue, Palette]:
    """Read the catalogue in a folder and prepare its images for rendering, once per process."""
    catalogue = read_catalogue(Path(data))
    return catalogue, Palette(catalogue)


def render_scenes(
    layouts: Layouts, textures: Sequence[str], seeds: Sequence[int], palette: Palette
) -> UInt8[Array, "scene 100 100 3"]:
    """Render every scene on its texture and under the light of its render seed."""
    images = np.empty((len(layouts), SIDE, SIDE, 3), np.uint8)
    for scene, (texture, seed) in enumerate(zip(textures, seeds, strict=True)):
        images[scene] = render(layouts, scene, texture, int(seed), palette)
    return images


def render(layouts: Layouts, scene: int, texture: str, seed: int, palette: Palette) -> UInt8[Array, "100 100 3"]:
    """Render one scene; raise InputError if the texture or an item is not in the palette."""
    if texture not in palette.surfaces:
        raise InputError(f"unknown texture {texture!r}: the catalogue has {sorted(palette.surfaces)}")
    light = draw_light(seed)
    image = _table_top(light, palette.surfaces[texture], palette.surface_widths[texture])
    stamps = [_stamp(layouts, scene, int(slot), light, palette) for slot in np.flatnonzero(layouts.present[scene])]
    for stamp in stamps:
        stamp.shade(image, light)
    for stamp in stamps:
        stamp.cover(image)
    image = cv2.sepFilter2D(image * _illumination(light), -1, LENS, LENS, borderType=cv2.BORDER_REPLICATE)
    return np.rint(np.clip(image + light.noise, 0, 1) * 255).astype(np.uint8)


def _pixel_centres(columns: Array, rows: Array) -> tuple[Array, Array]:
    """Return the table coordinates x, y [m] of pixel columns and rows."""
    return (columns + 0.5) / SIDE, 1.0 - (rows + 0.5) / SIDE


def _table_top(light: Light, surface: Array, width: float) -> Float32[Array, "side side 3"]:
    """Return the texture under a random turn and shift, repeated beyond its edges by reflection."""
    c, s = np.cos(light.turn), np.sin(light.turn)
    per_pixel = np.array(surface.shape[1::-1]) / width / SIDE  # texture columns and rows per image pixel
    turned = np.array([[c, s], [s, -c]]) * per_pixel[:, None]  # image rows grow towards the near edge
    middle = light.offset[::-1] * surface.shape[1::-1]  # of the table, in the texture
    matrix = np.column_stack([turned, middle - turned @ [SIDE / 2 - 0.5, SIDE / 2 - 0.5]])
    return cv2.warpAffine(surface, matrix, (SIDE, SIDE), flags=_LINEAR, borderMode=cv2.BORDER_REFLECT)


def _illumination(light: Light) -> Float32[Array, "side side 3"]:
    """Return the brightness over the table: gain and tint, less light far from the lamp, darker corners."""
    x, y = _pixel_centres(np.arange(SIDE)[None, :], np.arange(SIDE)[:, None])
    towards = (x - 0.5) * light.direction[0] + (y - 0.5) * light.direction[1]
    corner = ((x - 0.5) ** 2 + (y - 0.5) ** 2) / 0.5
    field = (1 + light.fall_off * towards) * (1 - light.vignette * corner)
    return field[..., None].astype(np.float32) * light.gain


@dataclass(frozen=True)
class _Stamp:
    """One item in its place: the window of the image it touches, its premultiplied colour and alpha there."""

    rows: slice
    columns: slice
    rgba: Float32[Array, "rows columns 4"]
    symbol: Symbol

    def shade(self, image: Array, light: Light) -> None:
        """Darken the table by the soft shadow, cast away from the lamp; a transparent item's rim casts one, too."""
        alpha = self.rgba[..., 3]
        solid = np.minimum(alpha * RIM_SHADOW, 1.0) if self.symbol.transparent else np.ascontiguousarray(alpha)
        height = self.symbol.height_m * SIDE
        shadow = np.zeros_like(solid)
        for reach, weight in LAMP:
            right, down = -light.direction[0] * height * reach, light.direction[1] * height * reach
            shadow += weight * cv2.warpAffine(solid, np.array([[1, 0, right], [0, 1, down]]), solid.shape[::-1])
        shadow = cv2.sepFilter2D(shadow, -1, SHADOW_BLUR, SHADOW_BLUR, borderType=cv2.BORDER_CONSTANT)
        image[self.rows, self.columns] *= 1 - self.symbol.shadow * shadow[..., None]

    def cover(self, image: Array) -> None:
        """Lay the item over the table (Porter and Duff's `over`)."""
        window = image[self.rows, self.columns]
        window *= 1 - self.rgba[..., 3:]
        window += self.rgba[..., :3]


def _stamp(layouts: Layouts, scene: int, slot: int, light: Light, palette: Palette) -> _Stamp:
    """Turn, scale and place one item: samples on a grid of SAMPLES per pixel, averaged over each pixel."""
    item = int(layouts.item[scene, slot])
    if not 0 <= item < len(palette.mipmaps):
        raise InputError(f"item {item} is not in the catalogue of {len(palette.mipmaps)} items: rerun stage scenes")
    symbol = TABLE[layouts.symbol[scene, slot]]
    centre, angle, scale = layouts.centre[scene, slot], layouts.angle[scene, slot], layouts.scale[scene, slot]
    width = palette.item_widths[item] * scale
    c, s = np.cos(angle), np.sin(angle)
    half = np.abs([c, s]) * layouts.half_length[scene, slot] + layouts.radius[scene, slot]  # of the bounding box [m]
    rows, columns = _window(centre, half + REACH_M)
    levels = palette.mipmaps[item]
    cutout = next((level for level in reversed(levels) if len(level) >= width * SIDE * SAMPLES), levels[0])
    # From sample (i, j) of the window to column and row of the cutout, both counted from the middle of pixel 0.
    per_sample = len(cutout) / (width * SIDE * SAMPLES)  # cutout pixels
    turned = per_sample * np.array([[c, -s], [s, c]])
    first_x, first_y = (columns.start + 0.5 / SAMPLES) / SIDE, 1 - (rows.start + 0.5 / SAMPLES) / SIDE  # [m]
    first = np.array([[c, s], [s, -c]]) @ [first_x - centre[0], first_y - centre[1]] / width
    matrix = np.column_stack([turned, (first + 0.5) * len(cutout) - 0.5])
    size = (columns.stop - columns.start, rows.stop - rows.start)
    samples = cv2.warpAffine(cutout, matrix, (size[0] * SAMPLES, size[1] * SAMPLES), flags=_LINEAR)
    rgba = cv2.resize(samples, size, interpolation=cv2.INTER_AREA)  # the mean over each pixel's samples
    return _Stamp(rows, columns, _lit(rgba, rows, columns, centre, half, symbol, light), symbol)


def _window(centre: Array, half: Array) -> tuple[slice, slice]:
    """Return the rows and columns of the image within `half` [m] of `centre`, clipped to the table."""
    column_low, column_high = np.floor((centre[0] + np.array([-half[0], half[0]])) * SIDE).astype(int)
    row_low, row_high = np.floor((1 - centre[1] + np.array([-half[1], half[1]])) * SIDE).astype(int)
    return (
        slice(max(row_low, 0), min(row_high + 1, SIDE)),
        slice(max(column_low, 0), min(column_high + 1, SIDE)),
    )


def _lit(
    rgba: Float32[Array, "rows columns 4"],
    rows: slice,
    columns: slice,
    centre: Array,
    half: Array,
    symbol: Symbol,
    light: Light,
) -> Float32[Array, "rows columns 4"]:
    """Light the evenly lit cutout from one side: hollow items are brighter away from the lamp, edges catch it."""
    x, y = _pixel_centres(np.arange(columns.start, columns.stop)[None, :], np.arange(rows.start, rows.stop)[:, None])
    towards = ((x - centre[0]) * light.direction[0] + (y - centre[1]) * light.direction[1]) / half.max()
    alpha = rgba[..., 3]
    slope_rows, slope_columns = np.gradient(alpha)
    edge = slope_rows * light.direction[1] - slope_columns * light.direction[0]  # > 0: the edge faces the lamp
    brightness = 1 - symbol.bowed * np.clip(towards, -1, 1) + EDGE_LIGHT * edge
    colour = np.clip(rgba[..., :3] * brightness[..., None], 0, alpha[..., None])
    return np.dstack([colour, alpha]).astype(np.float32)


def _mipmap(cutout: UInt8[Array, "side side 4"]) -> list[Array]:
    """Return a cutout in float32, premultiplied by its alpha, and ever coarser: each level half as fine as the last."""
    level = cutout.astype(np.float32) / 255
    level[..., :3] *= level[..., 3:]
    levels = [level]
    while len(levels[-1]) >= MIN_MIPMAP_PX:
        levels.append(_halved(levels[-1]))
    return levels


def _halved(image: Array) -> Array:
    rows, columns = image.shape[0] // 2, image.shape[1] // 2
    even = np.ascontiguousarray(image[: 2 * rows, : 2 * columns])
    return cv2.resize(even, (columns, rows), interpolation=cv2.INTER_AREA)


def _shrink(surface: Array, width_m: float) -> Array:
    """Halve the texture while it stays finer than TEXTURE_PX_PER_M."""
    while surface.shape[1] / 2 / width_m >= TEXTURE_PX_PER_M:
        surface = _halved(surface)
    return surface
