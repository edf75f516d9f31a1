"""Render scenes from above with OpenCV: 100 x 100 RGB images of the 1 m table, row 0 at the far edge.

Light and table top depend only on the scene's render seed, never on its items. An added item thus changes only the
pixels of the item and its shadow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Group, Range, ShareRange, Spread
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import APPEARANCES, SIDE, Layouts, Symbol

SAMPLES = 3  # samples per pixel along each axis, averaged
REACH_M = 0.04  # items and their shadows are drawn up to this far beyond the footprint, tall ones further
PENUMBRA = ((0.35, 0.3), (0.7, 0.4), (1.0, 0.3))  # shift and weight of the shadows that approximate a wide lamp's
SHADOW_BLUR = np.array([0.25, 0.5, 0.25], np.float32)  # blur kernel of a shadow along each axis
RIM_SHADOW = 4.0  # factor on a transparent item's alpha, up to 1, for its shadow
EDGE_LIGHT = 0.25  # brightness gained by an edge that faces the lamp
LENS = np.array([0.06, 0.88, 0.06], np.float32)  # the camera's blur kernel along each axis
MIN_MIPMAP_PX = 16  # smallest side of a mipmap level
TEXTURE_PX_PER_M = 150.0  # textures are halved while they keep at least this resolution

_LINEAR = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP  # matrices map image to source


class ImageSource(Group):
    """Ranges that the render seed draws from, uniformly; the defaults are those of conf/scenes.yaml."""

    exposure: Range = (0.86, 1.08)
    white_balance: Spread = 0.025
    fall_off: ShareRange = (0.02, 0.12)
    vignette: ShareRange = (0.02, 0.10)
    noise: ShareRange = (0.006, 0.016)

    def __hash__(self) -> int:
        return hash(tuple(vars(self).values()))


DRAWN = ImageSource()


@dataclass(frozen=True)
class Light:
    """Everything that the render seed decides about a scene: the table top's offset, the light and the noise."""

    offset: Float[Array, "2"]  # of the texture [texture widths]
    rotation: float  # rotation of the texture [rad]
    direction: Float[Array, "2"]  # unit vector on the table towards the lamp
    gain: Float32[Array, "3"]  # brightness and tint per channel
    fall_off: float  # share of brightness lost from the lit edge of the table to the opposite one
    vignette: float  # share of brightness lost in the corners
    noise: Float32[Array, "side side 3"]  # sensor noise [1 = white]


def draw_light(seed: int, source: ImageSource = DRAWN) -> Light:
    """Draw the light and the table top's offset of the scene with render seed `seed`."""
    rng = np.random.default_rng(seed)
    bearing = rng.uniform(-np.pi, np.pi)
    offset, rotation = rng.uniform(0.0, 1.0, 2), rng.uniform(-np.pi, np.pi)
    gain = rng.uniform(*source.exposure) * rng.normal(1.0, source.white_balance, 3)
    fall_off, vignette = rng.uniform(*source.fall_off), rng.uniform(*source.vignette)
    noise = rng.standard_normal((SIDE, SIDE, 3), np.float32) * np.float32(rng.uniform(*source.noise))
    direction = np.array([np.cos(bearing), np.sin(bearing)])
    return Light(offset, rotation, direction, gain.astype(np.float32), fall_off, vignette, noise)


class Palette:
    """Images prepared for rendering, premultiplied mipmaps of the cutouts and table tops at scale, and the source."""

    def __init__(self, catalogue: Catalogue, source: ImageSource = DRAWN) -> None:
        self.source = source
        items, textures = catalogue.items, catalogue.textures
        self.mipmaps: list[list[Array]] = []  # by item: float32, premultiplied by alpha, each half of the one before
        for cutout in catalogue.cutouts:
            levels = [cutout.astype(np.float32) / 255]
            levels[0][..., :3] *= levels[0][..., 3:]
            while len(levels[-1]) >= MIN_MIPMAP_PX:
                levels.append(_halved(levels[-1]))
            self.mipmaps.append(levels)
        self.item_widths = items["width_m"].to_numpy(float)
        self.surface_widths = dict(zip(textures["name"], textures["width_m"], strict=True))
        self.surfaces: dict[str, Array] = {}
        for name, surface in zip(textures["name"], catalogue.surfaces, strict=True):
            level = surface.astype(np.float32) / 255
            while level.shape[1] / 2 / self.surface_widths[name] >= TEXTURE_PX_PER_M:
                level = _halved(level)
            self.surfaces[name] = level


@lru_cache(maxsize=1)
def read_palette(data: str, source: ImageSource = DRAWN) -> tuple[Catalogue, Palette]:
    """Read the catalogue in a folder and prepare its images for rendering, once per process."""
    catalogue = read_catalogue(Path(data))
    return catalogue, Palette(catalogue, source)


def render_scenes(
    layouts: Layouts, textures: Sequence[str], seeds: Sequence[int], palette: Palette
) -> UInt8[Array, "scene 100 100 3"]:
    """Render each scene on its table top under the light of its render seed; return uint8 RGB images."""
    images = np.empty((len(layouts), SIDE, SIDE, 3), np.uint8)
    for scene, (texture, seed) in enumerate(zip(textures, seeds, strict=True)):
        images[scene] = render(layouts, scene, texture, int(seed), palette)
    return images


def render(layouts: Layouts, scene: int, texture: str, seed: int, palette: Palette) -> UInt8[Array, "100 100 3"]:
    """Render one scene; raise InputError if the palette lacks its texture or an item."""
    if texture not in palette.surfaces:
        raise InputError(f"unknown texture {texture!r}: the catalogue has {sorted(palette.surfaces)}")
    light = draw_light(seed, palette.source)
    image = _table_top(light, palette.surfaces[texture], palette.surface_widths[texture])
    stamps = [_stamp(layouts, scene, int(slot), light, palette) for slot in np.flatnonzero(layouts.present[scene])]
    for stamp in stamps:
        image[stamp.rows, stamp.columns] *= 1 - stamp.symbol.shadow * _shadow(stamp, light)[..., None]
    for stamp in stamps:
        window = image[stamp.rows, stamp.columns]
        window *= 1 - stamp.rgba[..., 3:]  # the `over` operator of Porter and Duff (1984)
        window += stamp.rgba[..., :3]
    image *= _illumination(light)
    image = cv2.sepFilter2D(image, -1, LENS, LENS, borderType=cv2.BORDER_REPLICATE)
    return np.rint(np.clip(image + light.noise, 0, 1) * 255).astype(np.uint8)


def _pixel_centres(columns: Array, rows: Array) -> tuple[Array, Array]:
    """Return the table coordinates x, y [m] of pixel columns and rows."""
    return (columns + 0.5) / SIDE, 1.0 - (rows + 0.5) / SIDE


def _table_top(light: Light, surface: Array, width: float) -> Float32[Array, "side side 3"]:
    """Return the table top: the texture, randomly rotated and shifted, reflected beyond its edges."""
    c, s = np.cos(light.rotation), np.sin(light.rotation)
    per_pixel = np.array(surface.shape[1::-1]) / width / SIDE  # texture columns and rows per image pixel
    turned = np.array([[c, s], [s, -c]]) * per_pixel[:, None]  # image rows grow towards the near edge
    middle = light.offset[::-1] * surface.shape[1::-1]  # the table's centre in the texture
    matrix = np.column_stack([turned, middle - turned @ [SIDE / 2 - 0.5, SIDE / 2 - 0.5]])
    return cv2.warpAffine(surface, matrix, (SIDE, SIDE), flags=_LINEAR, borderMode=cv2.BORDER_REFLECT)


def _illumination(light: Light) -> Float32[Array, "side side 3"]:
    """Return the illumination of the table: gain and tint, fall-off away from the lamp, vignette."""
    x, y = _pixel_centres(np.arange(SIDE)[None, :], np.arange(SIDE)[:, None])
    towards = (x - 0.5) * light.direction[0] + (y - 0.5) * light.direction[1]
    corner = ((x - 0.5) ** 2 + (y - 0.5) ** 2) / 0.5
    field = (1 + light.fall_off * towards) * (1 - light.vignette * corner)
    return field[..., None].astype(np.float32) * light.gain


class _Stamp(NamedTuple):
    """One placed item: the image window that it touches, with its premultiplied colour and alpha there."""

    rows: slice
    columns: slice
    rgba: Float32[Array, "rows columns 4"]
    symbol: Symbol


def _stamp(layouts: Layouts, scene: int, slot: int, light: Light, palette: Palette) -> _Stamp:
    """Rotate, scale and place one item on a grid of SAMPLES per pixel and axis, averaged over each pixel."""
    item = int(layouts.item[scene, slot])
    if not 0 <= item < len(palette.mipmaps):
        raise InputError(f"item {item} is not in the catalogue of {len(palette.mipmaps)} items: rerun stage scenes")
    symbol = APPEARANCES[layouts.symbol[scene, slot]]
    centre, angle, scale = layouts.centre[scene, slot], layouts.angle[scene, slot], layouts.scale[scene, slot]
    width = palette.item_widths[item] * scale
    c, s = np.cos(angle), np.sin(angle)
    half = np.abs([c, s]) * layouts.half_length[scene, slot] + layouts.radius[scene, slot]  # of the bounding box [m]
    rows, columns = _window(centre, half + max(REACH_M, symbol.height_m + REACH_M / 2))
    levels = palette.mipmaps[item]
    cutout = next((level for level in reversed(levels) if len(level) >= width * SIDE * SAMPLES), levels[0])
    # Maps sample (i, j) of the window to column and row of the cutout, counted from the centre of pixel 0.
    per_sample = len(cutout) / (width * SIDE * SAMPLES)  # cutout pixels per sample
    turned = per_sample * np.array([[c, -s], [s, c]])
    first_x, first_y = (columns.start + 0.5 / SAMPLES) / SIDE, 1 - (rows.start + 0.5 / SAMPLES) / SIDE  # [m]
    first = np.array([[c, s], [s, -c]]) @ [first_x - centre[0], first_y - centre[1]] / width
    matrix = np.column_stack([turned, (first + 0.5) * len(cutout) - 0.5])
    size = (columns.stop - columns.start, rows.stop - rows.start)
    samples = cv2.warpAffine(cutout, matrix, (size[0] * SAMPLES, size[1] * SAMPLES), flags=_LINEAR)
    rgba = cv2.resize(samples, size, interpolation=cv2.INTER_AREA)  # mean over each pixel's samples
    # Light comes from one side: a hollow item is brighter away from the lamp, an edge facing it.
    x, y = _pixel_centres(np.arange(columns.start, columns.stop)[None, :], np.arange(rows.start, rows.stop)[:, None])
    towards = ((x - centre[0]) * light.direction[0] + (y - centre[1]) * light.direction[1]) / half.max()
    alpha = rgba[..., 3]
    slope_rows, slope_columns = np.gradient(alpha)
    edge = slope_rows * light.direction[1] - slope_columns * light.direction[0]  # > 0: the edge faces the lamp
    brightness = 1 - symbol.concavity * np.clip(towards, -1, 1) + EDGE_LIGHT * edge
    colour = np.clip(rgba[..., :3] * brightness[..., None], 0, alpha[..., None])
    return _Stamp(rows, columns, np.dstack([colour, alpha]).astype(np.float32), symbol)


def _window(centre: Array, half: Array) -> tuple[slice, slice]:
    """Return the image rows and columns within `half` [m] of `centre`, clipped to the table."""
    column_low, column_high = np.floor((centre[0] + np.array([-half[0], half[0]])) * SIDE).astype(int)
    row_low, row_high = np.floor((1 - centre[1] + np.array([-half[1], half[1]])) * SIDE).astype(int)
    return (slice(max(row_low, 0), min(row_high + 1, SIDE)), slice(max(column_low, 0), min(column_high + 1, SIDE)))


def _shadow(stamp: _Stamp, light: Light) -> Float32[Array, "rows columns"]:
    """Return an item's soft shadow on the table, up to 1; a transparent item's rim casts one too."""
    alpha = stamp.rgba[..., 3]
    solid = np.minimum(alpha * RIM_SHADOW, 1.0) if stamp.symbol.transparent else np.ascontiguousarray(alpha)
    height = stamp.symbol.height_m * SIDE
    shadow = np.zeros_like(solid)
    for reach, weight in PENUMBRA:
        right, down = -light.direction[0] * height * reach, light.direction[1] * height * reach
        shadow += weight * cv2.warpAffine(solid, np.array([[1, 0, right], [0, 1, down]]), solid.shape[::-1])
    return cv2.sepFilter2D(shadow, -1, SHADOW_BLUR, SHADOW_BLUR, borderType=cv2.BORDER_CONSTANT)


def _halved(image: Array) -> Array:
    rows, columns = image.shape[0] // 2, image.shape[1] // 2
    even = np.ascontiguousarray(image[: 2 * rows, : 2 * columns])
    return cv2.resize(even, (columns, rows), interpolation=cv2.INTER_AREA)
