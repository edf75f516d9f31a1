"""Draw training pictures for the segmenter: cut-outs and procedural items on procedural table tops.

Pictures are those of pipeline/world/render.py: 100 x 100 pixels of a 1 m table, drawn at twice that resolution.
"""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray as Array

from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, segment_distance
from pipeline.world.symbols import SYMBOLS, TABLE
from studies.perception import items as draw
from studies.perception.items import Drawn, Frame
from studies.perception.tops import FAMILIES as FAMILIES
from studies.perception.tops import family_names as family_names
from studies.perception.tops.paint import SIDE_M, Top, noise
from studies.perception.tops.wear import worn

SAMPLES = 2  # samples per pixel along each axis
PX_PER_M = SIDE * SAMPLES
CANVAS_M = 1.08  # side of the drawn table [m]: the camera's perspective stays within it
CANVAS = round(CANVAS_M * PX_PER_M)
TOP = round(SIDE_M * PX_PER_M)
MAX_ITEMS = 6
MAX_SHADOW_M = 0.08
CUTOUT_CHANCE = 0.3  # share of items that are cut-outs of the catalogue, the others being procedural
MIN_GAP_M = 0.012  # smallest distance between footprints, a pixel; TIGHT_CHANCE of the scenes aim at it
TIGHT_CHANCE = 0.2
TOP_USES = 2  # scenes that share a drawn top, each with a turn, tint and light of its own

Window = tuple[slice, slice]  # rows and columns of the canvas


class Composites(NamedTuple):
    """A batch of pictures and what is on them."""

    images: UInt8[Array, "n 100 100 3"]
    instances: UInt8[Array, "n 100 100"]  # 0 is table, shadows included; 1.. are items
    empty: UInt8[Array, "n 100 100 3"]  # the same table, light and camera without items
    family: Array  # names of the tops' families (n,)


class Palette(NamedTuple):
    """The catalogue's training cut-outs: float32, premultiplied by alpha, at the scale of the drawn table."""

    cutouts: list[Float32[Array, "row column 4"]]
    width_m: Array
    half_length_m: Array
    radius_m: Array
    symbol: Array


@lru_cache(maxsize=1)
def read_palette(data: str) -> Palette:
    """Read the training items of the catalogue in a folder; raise CatalogueError if it is unusable."""
    catalogue = read_catalogue(Path(data))
    rows = catalogue.pool("train")
    table = catalogue.items.iloc[rows]
    cutouts = []
    for row, width in zip(rows, table["width_m"], strict=True):
        rgba = catalogue.cutouts[row].astype(np.float32) / 255
        rgba[..., :3] *= rgba[..., 3:]
        side = round(1.5 * width * PX_PER_M)
        cutouts.append(cv2.resize(rgba, (side, side), interpolation=cv2.INTER_AREA))
    symbol = np.array([SYMBOLS.index(s) for s in table["symbol"]])
    return Palette(
        cutouts, *(table[column].to_numpy(float) for column in ("width_m", "half_length_m", "radius_m")), symbol
    )


def draw_composites(rng: np.random.Generator, n: int, families: Sequence[str], palette: Palette) -> Composites:
    """Draw `n` pictures on tops of the named families with 0 to MAX_ITEMS items each.

    Raises ValueError for an unknown family.
    """
    if unknown := sorted(set(families) - set(FAMILIES)):
        raise ValueError(f"unknown families {unknown}: expected names from {sorted(FAMILIES)}")
    images, empty = np.empty((2, n, SIDE, SIDE, 3), np.uint8)
    instances = np.empty((n, SIDE, SIDE), np.uint8)
    names: list[str] = []
    for scene in range(n):
        if scene % TOP_USES == 0:
            name, top = draw_top(rng, families)
        names.append(name)
        images[scene], instances[scene], empty[scene] = draw_scene(rng, top, palette)
    return Composites(images, instances, empty, np.array(names))


def draw_top(rng: np.random.Generator, families: Sequence[str]) -> tuple[str, Top]:
    """Draw a top of one family, sometimes with others' laid on it or mixed in; return the first one's name too."""
    name = str(rng.choice(families))
    top = FAMILIES[name].draw(rng, TOP).astype(np.float32)
    while rng.random() < 0.22:
        other = FAMILIES[str(rng.choice(families))].draw(rng, TOP).astype(np.float32)
        if rng.random() < 0.4:
            top = top * (
                1 + (other.mean(2, keepdims=True) / max(float(other.mean()), 0.05) - 1) * rng.uniform(0.1, 0.6)
            )
        else:
            top += (other - top) * patch(rng)[..., None]
    if rng.random() < 0.3:
        top = worn(rng, top)
    return name, np.clip(top, 0.005, 1.2).astype(np.float32)


def patch(rng: np.random.Generator) -> Float32[Array, "side side"]:
    """Return the share of another material: a runner, a place-mat, a round cloth, an edge or blots."""
    mask = np.zeros((TOP, TOP), np.uint8)
    kind, centre = rng.integers(5), rng.uniform(0.1, 0.9, 2) * TOP
    half = np.array([[2, rng.uniform(0.1, 0.3)], rng.uniform(0.13, 0.4, 2), [0.9, 0.9]][min(kind, 2)]) * TOP
    if kind == 3:
        cv2.circle(mask, np.int32(centre).tolist(), int(rng.uniform(0.15, 0.5) * TOP), 255, -1, cv2.LINE_AA)
    elif kind == 4:
        return np.clip((noise(rng, TOP, rng.uniform(2, 5), 3) - rng.uniform(0, 1)) / 0.1, 0, 1)
    else:
        if kind == 2:
            centre = centre + half * rng.choice([-1, 1], 2)
        box = cv2.boxPoints((centre.tolist(), (2 * half).tolist(), rng.uniform(0, 180)))
        cv2.fillConvexPoly(mask, np.int32(box), 255, cv2.LINE_AA)
    return mask.astype(np.float32) / 255


class Lamp(NamedTuple):
    """A lamp: its direction on the picture (columns, rows), shadow length over height, and share of the light."""

    direction: Array
    slant: float
    share: float
    softness_m: float


def draw_scene(rng: np.random.Generator, top: Top, palette: Palette) -> tuple[Array, Array, Array]:
    """Draw one scene on a top; return its picture, instances and picture without items."""
    table = turned(rng, top)
    lamps = draw_lamps(rng)
    illumination = draw_illumination(rng, lamps)
    illumination *= np.float32(exposed(rng, table, illumination))
    windows, drawn = draw_items(rng, palette, lamps, top)
    light = shadows(windows, drawn, lamps, rng)
    scene = table * light
    labels = np.zeros((CANVAS, CANVAS), np.uint8)
    for k, (window, item) in enumerate(zip(windows, drawn, strict=True), 1):
        cover(scene, window, item)
        labels[window][item.silhouette] = k
    camera = draw_camera(rng)
    empty = camera.take(rng, table * illumination)
    image = camera.take(rng, scene * illumination) if drawn else camera.take(rng, table * illumination)
    return image, camera.label(labels, len(drawn)), empty


def turned(rng: np.random.Generator, top: Top) -> Top:
    """Return a part of the top, turned, scaled, mirrored and tinted at random."""
    angle, scale = rng.uniform(0, 2 * np.pi), rng.uniform(0.6, 1.1)
    if rng.random() < 0.5:
        angle = np.round(angle / (np.pi / 2)) * np.pi / 2 + rng.normal(0, 0.03)
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    turn = np.array([[c, -s], [s, c * (1 if rng.random() < 0.5 else -1)]])
    middle = TOP / 2 + rng.uniform(-0.1, 0.1, 2) * TOP
    matrix = np.column_stack([turn, middle - turn @ [CANVAS / 2, CANVAS / 2]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    table = cv2.warpAffine(top, matrix, (CANVAS, CANVAS), flags=flags, borderMode=cv2.BORDER_REFLECT)
    if rng.random() < 0.3:
        table = table[..., rng.permutation(3)]
    grey = table.mean(2, keepdims=True)
    table = grey + (table - grey) * np.float32(rng.uniform(0.3, 1.2))
    table = (table - table.mean()) * np.float32(rng.uniform(0.4, 1.15)) + table.mean()
    return np.clip(table, 0.01, 1.1) ** np.float32(np.exp(rng.normal(0, 0.15)))


def draw_lamps(rng: np.random.Generator) -> list[Lamp]:
    """Draw one to three lamps that share the direct light; the rest is ambient."""
    count = int(rng.choice([1, 2, 3], p=[0.65, 0.25, 0.1]))
    direct = rng.uniform(0.2, 0.9)
    shares = rng.dirichlet(np.full(count, 2.0)) * direct
    lamps = []
    for share in shares:
        bearing = rng.uniform(0, 2 * np.pi)
        direction = np.array([np.cos(bearing), np.sin(bearing)])
        slant = float(np.exp(rng.uniform(-1.2, 1.1))) if rng.random() < 0.5 else rng.uniform(1, 4)
        lamps.append(Lamp(direction, slant, float(share), rng.uniform(0.002, 0.03)))
    return lamps


def draw_illumination(rng: np.random.Generator, lamps: list[Lamp]) -> Float32[Array, "side side 3"]:
    """Return the light on the bare table: exposure, white balance, fall-off, pools of light, glare and soft shade."""
    along = np.linspace(-0.5, 0.5, CANVAS, dtype=np.float32)
    x, y = along[None, :], along[:, None]
    field = 1 + rng.uniform(0, 0.5) ** 1.5 * (x * lamps[0].direction[0] + y * lamps[0].direction[1])
    centre = rng.uniform(-0.5, 0.5, 2)
    field = field * (1 - rng.uniform(0, 0.35) ** 1.5 * ((x - 0.3 * centre[0]) ** 2 + (y - 0.3 * centre[1]) ** 2) * 2)
    if rng.random() < 0.25:
        width = rng.uniform(0.15, 0.6)
        field = field * (1 + rng.uniform(0, 0.5) * np.exp(-((x - centre[0]) ** 2 + (y - centre[1]) ** 2) / width**2))
    if rng.random() < 0.2:
        shade = noise(rng, CANVAS, rng.uniform(2, 6), 2)
        field = field * (
            1 - rng.uniform(0.05, 0.4) * np.clip((shade - rng.uniform(-0.5, 1)) / rng.uniform(0.1, 1), 0, 1)
        )
    if rng.random() < 0.2:
        field = field * (1 - rng.uniform(0.1, 0.6) * outside_shadow(rng))
    return field[..., None].astype(np.float32) * rng.normal(1, 0.06, 3).astype(np.float32)


def outside_shadow(rng: np.random.Generator) -> Float32[Array, "side side"]:
    """Return the shadow of what stands or hangs outside the picture: window bars, edges, blots."""
    mask = np.zeros((CANVAS, CANVAS), np.uint8)
    turn, kind = rng.uniform(0, 180), rng.integers(3)
    for _ in range(rng.integers(1, 5)):
        centre = rng.uniform(0, CANVAS, 2)
        if kind < 2:
            size = [2.0 * CANVAS, rng.uniform(0.02, 0.08 if kind else 0.5) * CANVAS]
            turn += 90.0 * rng.integers(2)
        else:
            size, turn = rng.uniform(0.06, 0.4, 2) * CANVAS, rng.uniform(0, 180)
        if kind < 2:
            cv2.fillConvexPoly(mask, np.int32(cv2.boxPoints((centre.tolist(), list(size), turn))), 255)  # pyright: ignore
        else:
            cv2.ellipse(mask, (centre.tolist(), list(size), turn), 255, -1)  # pyright: ignore
    return cv2.GaussianBlur(mask, (0, 0), np.exp(rng.uniform(0, 2.3))).astype(np.float32) / 255


def exposed(rng: np.random.Generator, table: Top, illumination: Float32[Array, "side side 3"]) -> float:
    """Return the gain of a camera that brings the table part of the way to a medium brightness."""
    brightness = float((table[::8, ::8] * illumination[::8, ::8]).mean())
    return (rng.uniform(0.25, 0.7) / max(brightness, 0.03)) ** rng.uniform(0.2, 1) * np.exp(rng.normal(0, 0.1))


def draw_items(
    rng: np.random.Generator, palette: Palette, lamps: list[Lamp], top: Top
) -> tuple[list[Window], list[Drawn]]:
    """Draw the items and the windows of the canvas that they fill; some are made of what tops are made of."""
    count = int(rng.choice(MAX_ITEMS + 1, p=[0.06, 0.14, 0.24, 0.24, 0.16, 0.1, 0.06]))
    tight, tall = rng.random() < TIGHT_CHANCE, rng.random() < 0.5
    segments, radii = np.empty((0, 2, 2)), np.empty(0)
    windows, drawn = [], []
    for _ in range(count):
        kind = "cutout" if rng.random() < CUTOUT_CHANCE else rng.choice(KINDS, p=SHARES)
        scale = rng.uniform(0.7, 1.4) if rng.random() < 0.5 else rng.uniform(0.9, 1.1)
        index = int(rng.integers(len(palette.cutouts)))
        half, radius = size_of(rng, kind, scale, palette, index)
        place = place_item(rng, half - radius, radius, segments, radii, tight)
        if place is None:
            continue
        centre, angle, segment = place
        segments, radii = np.concatenate([segments, segment[None]]), np.append(radii, radius)
        lean = np.zeros(2) if not tall else (centre - CANVAS_M / 2) * 0.06
        reach = half + 0.01 + np.abs(lean).max()
        window, frame = frame_of(centre, angle, reach, lamps[0])
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        if kind == "cutout":
            item = cut_out(rng, palette, index, scale, frame)
        elif kind == "glass":
            item = draw.clear_glass(rng, frame, radius, turn @ lean)
            assert item.bend_m is not None
            item = item._replace(bend_m=item.bend_m @ turn)
        elif kind == "cutlery":
            item = draw.cutlery(rng, frame, half, radius)
        elif kind == "box":
            item = draw.box(rng, frame, half, radius)
        else:
            item = (draw.mug if kind == "mug" else draw.crockery)(rng, frame, radius)
        if item.bend_m is None and kind != "cutout" and rng.random() < 0.18:
            item = resurfaced(rng, item, top)
        windows.append(window)
        drawn.append(item)
    return windows, drawn


def resurfaced(rng: np.random.Generator, item: Drawn, top: Top) -> Drawn:
    """Return an item that is hard to see: translucent, of the table's colour, or of a material of tables."""
    kind = rng.random()
    if kind < 0.3:
        share = np.float32(rng.uniform(0.3, 0.85))
        return item._replace(alpha=item.alpha * share, blocks=item.blocks * share)
    if kind < 0.65:
        shade = item.rgb[item.silhouette].mean(0) if item.silhouette.any() else np.ones(3)
        likeness = top[::16, ::16].mean((0, 1)) * rng.normal(1, 0.1) / np.maximum(shade, 0.05)
        return item._replace(rgb=(item.rgb * np.minimum(likeness, 4)).astype(np.float32))
    rows, columns = item.alpha.shape
    side = int(rng.uniform(60, TOP))
    left, up = rng.integers(0, TOP - side + 1, 2)
    swatch = cv2.resize(top[up : up + side, left : left + side], (columns, rows), interpolation=cv2.INTER_AREA)
    swatch = swatch[..., rng.permutation(3)] if rng.random() < 0.6 else swatch
    mean = float(item.rgb[item.silhouette].mean()) if item.silhouette.any() else 1.0
    light = item.rgb.mean(2, keepdims=True) / max(mean, 0.05)
    return item._replace(rgb=(swatch * light * np.float32(rng.uniform(0.6, 1.4))).astype(np.float32))


KINDS = ("crockery", "glass", "cutlery", "mug", "box")
SHARES = (0.34, 0.32, 0.22, 0.06, 0.06)


def size_of(rng: np.random.Generator, kind: str, scale: float, palette: Palette, index: int) -> tuple[float, float]:
    """Return an item's half-length, ends included, and the radius of its footprint [m]."""
    if kind == "cutout":
        radius = palette.radius_m[index] * scale
        return float(palette.half_length_m[index] * scale + radius), float(radius)
    if kind == "cutlery":
        return rng.uniform(0.08, 0.1) * scale, 0.013 * rng.uniform(0.7, 1.4)
    if kind == "box":
        half = rng.uniform(0.05, 0.09) * scale
        return half, half * rng.uniform(0.4, 1)
    low, high = {"glass": (0.038, 0.05), "mug": (0.045, 0.065), "crockery": (0.055, 0.085)}[kind]
    radius = rng.uniform(low, high) * scale
    return radius, radius


def place_item(
    rng: np.random.Generator, half: float, radius: float, segments: Array, radii: Array, tight: bool
) -> tuple[Array, float, Array] | None:
    """Return a free place: centre [m] on the canvas, angle and segment; None if there is none."""
    low = -0.02 if rng.random() < 0.15 else 0.1
    centres = rng.uniform(low, CANVAS_M - low, (96, 2))
    angles = rng.uniform(-np.pi, np.pi, 96)
    arms = np.stack([np.cos(angles), np.sin(angles)], -1) * half
    places = np.stack([centres - arms, centres + arms], 1)
    if not len(radii):
        return centres[0], float(angles[0]), places[0]
    gaps = (segment_distance(places[:, None], segments[None]) - radii).min(1) - radius
    free = np.flatnonzero(gaps > (MIN_GAP_M if tight else rng.choice([0.015, 0.03])))
    if not len(free):
        return None
    pick = free[np.argmin(gaps[free])] if tight else free[0]
    return centres[pick], float(angles[pick]), places[pick]


def frame_of(centre: Array, angle: float, reach: float, lamp: Lamp) -> tuple[Window, Frame]:
    """Return the canvas window around an item and its pixels in the item's own coordinates."""
    first = np.clip(np.floor((centre - reach) * PX_PER_M), 0, CANVAS - 2).astype(int)
    last = np.clip(np.ceil((centre + reach) * PX_PER_M), first + 2, CANVAS).astype(int)
    x = (np.arange(first[0], last[0], dtype=np.float32) + 0.5) / PX_PER_M - np.float32(centre[0])
    y = ((np.arange(first[1], last[1], dtype=np.float32) + 0.5) / PX_PER_M - np.float32(centre[1]))[:, None]
    c, s = np.float32(np.cos(angle)), np.float32(np.sin(angle))
    towards = np.array([[c, s], [-s, c]]) @ lamp.direction
    return (slice(first[1], last[1]), slice(first[0], last[0])), Frame(c * x + s * y, c * y - s * x, towards)


def cut_out(rng: np.random.Generator, palette: Palette, index: int, scale: float, frame: Frame) -> Drawn:
    """Return a cut-out in its frame, with another tint, contrast and sometimes another decoration."""
    source, symbol = palette.cutouts[index], TABLE[palette.symbol[index]]
    per_m = np.float32(len(source) / (palette.width_m[index] * scale))
    columns, rows = (frame.x * per_m + len(source) / 2 - 0.5), (frame.y * per_m + len(source) / 2 - 0.5)
    rgba = cv2.remap(source, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    alpha = rgba[..., 3]
    rgb = rgba[..., :3] / np.maximum(alpha, 1e-3)[..., None]
    if rng.random() < 0.5:
        rgb = rgb[..., rng.permutation(3)]
    rgb = rgb ** np.float32(np.exp(rng.normal(0, 0.35))) * rng.normal(1, 0.15, 3).astype(np.float32)
    if rng.random() < 0.25 and not symbol.transparent:
        half = max(palette.width_m[index] * scale / 2, 0.02)
        rgb = rgb * (draw.decorated(rng, frame.x, frame.y, half) + 0.15)
    towards = (frame.x * frame.lamp[0] + frame.y * frame.lamp[1]) / (palette.width_m[index] * scale / 2)
    rgb = rgb * (1 - rng.uniform(0, 2) * symbol.concavity * np.clip(towards, -1, 1))[..., None]
    height = symbol.height_m * rng.uniform(0.5, 3)
    if not symbol.transparent:
        return Drawn(rgb.astype(np.float32), alpha, alpha > 0.5, height, alpha)
    outline, _ = cv2.findContours((alpha > 0.05).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = cv2.drawContours(np.zeros(alpha.shape, np.uint8), outline, -1, 1, cv2.FILLED).astype(bool)
    return Drawn(rgb.astype(np.float32), alpha, filled, height * 2, np.minimum(alpha * rng.uniform(1, 4), 1))


def shadows(
    windows: list[Window], drawn: list[Drawn], lamps: list[Lamp], rng: np.random.Generator
) -> Float32[Array, "side side 3"]:
    """Return the share of the light that reaches the table: shadows of each lamp, contact shade and caustics."""
    light = np.ones((CANVAS, CANVAS, 3), np.float32)
    if not drawn:
        return light
    tint = 1 - rng.uniform(0, 0.12, 3).astype(np.float32) * np.array([1, 0.8, 0.4], np.float32)
    contact = np.zeros((CANVAS, CANVAS), np.uint8)
    for window, item in zip(windows, drawn, strict=True):
        contact[window] = np.maximum(contact[window], (item.blocks * 255).astype(np.uint8))
    for lamp in lamps:
        shade = np.zeros((CANVAS, CANVAS), np.uint8)
        for step in (0.15, 0.4, 0.7, 1.0):
            layer = np.zeros((CANVAS, CANVAS), np.uint8)
            for window, item in zip(windows, drawn, strict=True):
                shift = -lamp.direction * min(item.height_m * lamp.slant, MAX_SHADOW_M) * step * PX_PER_M
                paste(layer, window, (item.blocks * 255).astype(np.uint8), shift)
            sigma = 0.6 + lamp.softness_m * PX_PER_M * step
            shade = np.maximum(shade, cv2.GaussianBlur(layer, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE))
        light -= (shade.astype(np.float32) * np.float32(lamp.share / 255))[..., None] * tint
    around = cv2.GaussianBlur(contact, (0, 0), rng.uniform(1.5, 6)).astype(np.float32) / 255
    light *= (1 - rng.uniform(0, 0.4) * around)[..., None]
    for window, item in zip(windows, drawn, strict=True):
        if item.bend_m is not None and rng.random() < 0.6:
            caustic(light, window, item, lamps[0], rng)
    return np.clip(light, 0.05, 2)


def paste(layer: Array, window: Window, mask: Array, shift: Array) -> None:
    """Set the maximum of a layer and a mask that is moved by whole pixels."""
    right, down = np.rint(shift).astype(int)
    rows, columns = window
    top, left = rows.start + down, columns.start + right
    bottom, end = top + mask.shape[0], left + mask.shape[1]
    inner = slice(max(top, 0), min(bottom, CANVAS)), slice(max(left, 0), min(end, CANVAS))
    if inner[0].start >= inner[0].stop or inner[1].start >= inner[1].stop:
        return
    part = mask[inner[0].start - top : inner[0].stop - top, inner[1].start - left : inner[1].stop - left]
    np.maximum(layer[inner], part, out=layer[inner])


def caustic(light: Array, window: Window, item: Drawn, lamp: Lamp, rng: np.random.Generator) -> None:
    """Brighten the middle of a clear item's shadow."""
    rows, columns = window
    size = (columns.stop - columns.start) / 2
    centre = np.array([columns.start + columns.stop, rows.start + rows.stop]) / 2
    centre = centre - lamp.direction * (
        min(item.height_m * lamp.slant, MAX_SHADOW_M) * rng.uniform(0.3, 1) * PX_PER_M + size * 0.2
    )
    reach = int(size) + 1
    low = np.clip(np.floor(centre - reach), 0, CANVAS).astype(int)
    high = np.clip(np.ceil(centre + reach), 0, CANVAS).astype(int)
    if (low >= high).any():
        return
    x = (np.arange(low[0], high[0], dtype=np.float32) - np.float32(centre[0])) / np.float32(size)
    y = ((np.arange(low[1], high[1], dtype=np.float32) - np.float32(centre[1])) / np.float32(size))[:, None]
    along = x * lamp.direction[0] + y * lamp.direction[1]
    across = y * lamp.direction[0] - x * lamp.direction[1]
    glow = np.exp(-((along / rng.uniform(0.15, 0.5)) ** 2) - (across / rng.uniform(0.1, 0.4)) ** 2)
    light[low[1] : high[1], low[0] : high[0]] += (glow * rng.uniform(0.1, 0.7) * lamp.share)[..., None]


def cover(scene: Array, window: Window, item: Drawn) -> None:
    """Set an item over the scene; through a clear one the scene is seen bent."""
    part = scene[window]
    if item.bend_m is not None:
        rows, columns = window
        x = np.arange(columns.start, columns.stop, dtype=np.float32)[None, :] + (item.bend_m[..., 0] * PX_PER_M)
        y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] + (item.bend_m[..., 1] * PX_PER_M)
        seen = cv2.remap(
            scene, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
        )
        part = np.where(item.silhouette[..., None], seen, part)
    scene[window] = part + (item.rgb - part) * item.alpha[..., None]


class Camera(NamedTuple):
    """A camera: where it sees the table, its blur, noise, gamma and JPEG quality."""

    view: Array  # homography from its finer picture to the canvas
    blur: float  # [fine pixels]
    noise: float
    shot: float  # noise that grows with the square root of the light
    gamma: float
    shoulder: bool  # whether highlights are compressed, as on film, or clipped
    jpeg: int | None
    glare: Float32[Array, "side side"] | None

    def take(self, rng: np.random.Generator, canvas: Array) -> UInt8[Array, "100 100 3"]:
        """Return the picture of a canvas."""
        side = SIDE * SAMPLES
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(
            canvas.astype(np.float32), self.view, (side, side), flags=flags, borderMode=cv2.BORDER_REFLECT
        )
        if self.blur > 0.3:
            seen = cv2.GaussianBlur(seen, (0, 0), self.blur)
        picture = cv2.resize(seen, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
        if self.glare is not None:
            picture = picture + self.glare[..., None]
        picture = np.clip(picture, 0, None) ** np.float32(self.gamma)
        if self.shoulder:
            picture = 1.05 * (1 - np.exp(-1.5 * picture))
        spread = self.noise + self.shot * np.sqrt(np.clip(picture, 0, 1))
        picture = picture + rng.standard_normal(picture.shape, np.float32) * spread
        picture = np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)
        if self.jpeg is not None:
            coded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, self.jpeg])[1]
            picture = cv2.imdecode(coded, cv2.IMREAD_COLOR)
        return picture

    def label(self, labels: UInt8[Array, "side side"], count: int) -> UInt8[Array, "100 100"]:
        """Return the item that covers at least half of each pixel, 0 for the table."""
        side = SIDE * SAMPLES
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        seen = cv2.warpPerspective(labels, self.view, (side, side), flags=flags, borderMode=cv2.BORDER_REFLECT)
        result, best = np.zeros((SIDE, SIDE), np.uint8), np.full((SIDE, SIDE), 126, np.uint8)
        number = 0
        for k in range(1, count + 1):
            share = cv2.resize(
                np.where(seen == k, np.uint8(255), np.uint8(0)), (SIDE, SIDE), interpolation=cv2.INTER_AREA
            )
            if (larger := share > best).any():
                number += 1
                result[larger], best[larger] = number, share[larger]
        return result


def draw_camera(rng: np.random.Generator) -> Camera:
    """Draw a camera above the table, tilted by up to a few degrees."""
    margin, side = (CANVAS_M - 1) / 2, SIDE * SAMPLES
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    tilt = rng.uniform(-1, 1, (4, 2)) * margin * rng.choice([0.0, 0.3, 1.0])
    corners = (square + margin + tilt) * PX_PER_M - 0.5
    view = cv2.getPerspectiveTransform(np.float32(square * side - 0.5), np.float32(corners))  # pyright: ignore
    glare = None
    if rng.random() < 0.25:
        along = np.linspace(-0.5, 0.5, SIDE, dtype=np.float32)
        centre, turn, width = rng.uniform(-0.6, 0.6, 2), rng.uniform(0, np.pi), rng.uniform(0.05, 0.5, 2)
        x, y = along[None, :] - np.float32(centre[0]), along[:, None] - np.float32(centre[1])
        u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
        glare = (rng.uniform(0.05, 0.5) * np.exp(-((u / width[0]) ** 2) - (v / width[1]) ** 2)).astype(np.float32)
    return Camera(
        view,
        rng.uniform(0.3, 1.6) if rng.random() < 0.6 else 0.0,
        float(np.exp(rng.uniform(-7, -4))),
        rng.uniform(0, 0.15) ** 2,
        float(np.exp(rng.normal(0, 0.15))),
        rng.random() < 0.5,
        int(rng.integers(50, 96)) if rng.random() < 0.3 else None,
        glare,
    )
