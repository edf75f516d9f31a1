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

from making.segmenter import camera
from making.segmenter import items as draw
from making.segmenter.camera import CANVAS, CANVAS_M, PX_PER_M, Lamp, Window
from making.segmenter.items import Drawn, Frame
from making.segmenter.paint import SIDE_M, Rng, Top
from making.segmenter.tops import FAMILIES as FAMILIES
from making.segmenter.tops import draw_top
from making.segmenter.tops import family_names as family_names
from pipeline.perception.segmenter import LOOKS
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import APPEARANCES, SYMBOLS, segment_distance

TOP = round(SIDE_M * PX_PER_M)  # side of a drawn top [pixels]
SEE_THROUGH = 0.5  # mean alpha below which an item lets the table show through
TOP_USES = 2  # scenes that share a drawn top, each with a turn, tint and light of its own
MAX_ITEMS = 6
COUNTS = (0.06, 0.14, 0.24, 0.24, 0.16, 0.1, 0.06)  # chances of 0 .. MAX_ITEMS items, unless the table is full
FULL_CHANCE, MOST = 0.35, 20  # share of the scenes with up to MOST items
NEAR_CHANCE, NEAREST = 0.5, 4.0  # share of the scenes whose camera is nearer, by up to this factor
ASLANT_CHANCE, SLANT = 0.4, (0.25, 1.3)  # share of the scenes seen aslant, and the lean of what stands, over its height
MAX_LEAN_M = 0.4
CUTOUT_CHANCE = 0.3  # share of items that are cut-outs of the catalogue; the others are procedural
KINDS = ("crockery", "glass", "cutlery", "mug", "box", "lying", "tool")
SHARES = (0.3, 0.27, 0.19, 0.06, 0.06, 0.06, 0.06)  # of the procedural kinds
STANDING_CHANCE = 0.5  # share of items, in scenes seen aslant, that stand and show their side
CLEAR_CHANCE = 0.35  # share of what stands or lies that is clear
MIN_GAP_M = 0.012  # smallest distance between footprints, a pixel; TIGHT_CHANCE of the scenes aim at it
OVERLAP_CHANCE, OVERLAP_M = 0.08, 0.03  # share of the scenes whose items may cover one another, and how far
TIGHT_CHANCE = 0.2
RESURFACED_CHANCE = 0.16  # share of opaque items made translucent, or of the table's colour or material
PLACES = 96  # random places among which a free one is sought


class Palette(NamedTuple):
    """The catalogue's training cut-outs: float32, premultiplied by alpha, at the scale of the drawn table."""

    cutouts: list[Float32[Array, "row column 4"]]
    width_m: Array
    half_length_m: Array
    radius_m: Array
    symbol: Array


class Composites(NamedTuple):
    """A batch of pictures and what is on them."""

    images: UInt8[Array, "n 100 100 3"]
    instances: UInt8[Array, "n 100 100"]  # 0 is table, shadows included; 1.. are items
    empty: UInt8[Array, "n 100 100 3"]  # the same table, light and camera without items
    family: Array  # names of the tops' families (n,)
    see_through: UInt8[Array, "n 100 100"]  # 1 where the item there lets the table show through
    look: UInt8[Array, "n 100 100"]  # 1 + number in LOOKS of the item there, 0 for the table


class Setting(NamedTuple):
    """A table, its light and the camera above it."""

    table: Top
    lamps: list[Lamp]
    illumination: camera.Picture
    lens: camera.Camera


def draw_composites(rng: Rng, n: int, families: Sequence[str], palette: Palette) -> Composites:
    """Draw `n` pictures on tops of the named families with 0 to 6 items each.

    Raises ValueError for an unknown family.
    """
    if unknown := sorted(set(families) - set(FAMILIES)):
        raise ValueError(f"unknown families {unknown}: expected names from {sorted(FAMILIES)}")
    names, scenes = [], []
    for scene in range(n):
        if scene % TOP_USES == 0:
            name, top = draw_top(rng, families, TOP)
        names.append(name)
        scenes.append(draw_scene(rng, draw_setting(rng, top), palette))
    return _batch(scenes, names)


def draw_arrangements(rng: Rng, n: int, family: str, palette: Palette) -> Composites:
    """Draw `n` arrangements on one table under one camera, whose light varies a little."""
    name, top = draw_top(rng, [family], TOP)
    setting = draw_setting(rng, top)
    gains = rng.normal(1, 0.03, n).astype(np.float32)
    scenes = [draw_scene(rng, setting._replace(illumination=setting.illumination * g), palette) for g in gains]
    return _batch(scenes, [name] * n)


def _batch(scenes: list[tuple[Array, Array, Array, Array, Array]], families: list[str]) -> Composites:
    """Return scenes of `draw_scene` as one batch."""
    images, instances, empty, see_through, look = (np.stack(parts) for parts in zip(*scenes, strict=True))
    return Composites(images, instances, empty, np.array(families), see_through, look)


def draw_setting(rng: Rng, top: Top) -> Setting:
    """Draw a table with its light and camera."""
    table = turned(rng, top)
    lamps = camera.draw_lamps(rng)
    illumination = camera.draw_illumination(rng, lamps)
    brightness = max(float((table[::8, ::8] * illumination[::8, ::8]).mean()), 0.03)
    gain = (rng.uniform(0.25, 0.7) / brightness) ** rng.uniform(0.2, 1) * np.exp(rng.normal(0, 0.1))
    illumination *= np.float32(gain)  # the camera brings the table part of the way to a medium brightness
    return Setting(table, lamps, illumination, camera.draw_camera(rng))


def draw_scene(rng: Rng, setting: Setting, palette: Palette) -> tuple[Array, Array, Array, Array, Array]:
    """Draw one scene; return its picture, instances, picture without items, see-through pixels and looks."""
    table, lamps, illumination, lens = setting
    placed = draw_items(rng, palette, lamps, table)
    scene = table * camera.shadows(placed, lamps, rng)
    labels, clear, look = np.zeros((3, CANVAS, CANVAS), np.uint8)
    for k, (window, item) in enumerate(placed, 1):
        cover(scene, window, item)
        labels[window][item.silhouette] = k
        look[window][item.silhouette] = 1 + LOOKS.index(item.look)
        clear[window][item.silhouette] = item.alpha[item.silhouette].sum() < SEE_THROUGH * item.silhouette.sum()
    image, empty = (lens.take(rng, lit * illumination) for lit in (scene, table))
    instances = lens.label(labels, len(placed))
    shown = instances > 0
    return image, instances, empty, lens.label(clear, 1) * shown, lens.label(look, len(LOOKS)) * shown


def turned(rng: Rng, top: Top) -> Top:
    """Return a part of the top, turned, scaled, mirrored and tinted at random."""
    angle, scale = rng.uniform(0, 2 * np.pi), rng.uniform(0.6, 1.1)
    if rng.random() < 0.5:
        angle = np.round(angle / (np.pi / 2)) * np.pi / 2 + rng.normal(0, 0.03)
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    mirror = rng.choice([-1, 1])
    turn = np.array([[c, -s * mirror], [s, c * mirror]])
    middle = TOP / 2 + rng.uniform(-0.1, 0.1, 2) * TOP
    matrix = np.column_stack([turn, middle - turn @ [CANVAS / 2, CANVAS / 2]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    table = cv2.warpAffine(top, matrix, (CANVAS, CANVAS), flags=flags, borderMode=cv2.BORDER_REFLECT)
    if rng.random() < 0.3:
        table = table[..., rng.permutation(3)]
    grey = cv2.cvtColor(table, cv2.COLOR_RGB2GRAY)[..., None]
    table = grey + (table - grey) * np.float32(rng.uniform(0.4, 1.3))
    table = (table - table.mean()) * np.float32(rng.uniform(0.45, 1.3)) + table.mean()
    return np.clip(table, 0.01, 1.1) ** np.float32(np.exp(rng.normal(0, 0.15)))


def cover(scene: Array, window: Window, item: Drawn) -> None:
    """Set an item over the scene; through a clear one the scene is seen bent."""
    part = scene[window]
    if item.bend_m is not None:
        rows, columns = window
        x = np.arange(columns.start, columns.stop, dtype=np.float32)[None, :] + (item.bend_m[..., 0] * PX_PER_M)
        y = np.arange(rows.start, rows.stop, dtype=np.float32)[:, None] + (item.bend_m[..., 1] * PX_PER_M)
        places = x.astype(np.float32), y.astype(np.float32)
        seen = cv2.remap(scene, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        part = np.where(item.silhouette[..., None], seen, part)
    scene[window] = part + (item.rgb - part) * item.alpha[..., None]


@lru_cache(maxsize=1)
def read_palette(data: str) -> Palette:
    """Read the training items of the catalogue in a folder; raise InputError if it is unusable."""
    catalogue = read_catalogue(Path(data))
    rows = catalogue.pool("train")
    table = catalogue.items.iloc[rows]
    cutouts = []
    for row, width in zip(rows, table["width_m"], strict=True):
        rgba = catalogue.cutouts[row].astype(np.float32) / 255
        rgba[..., :3] *= rgba[..., 3:]
        side = round(1.5 * width * PX_PER_M)
        cutouts.append(cv2.resize(rgba, (side, side), interpolation=cv2.INTER_AREA))
    width, half_length, radius = (table[c].to_numpy(float) for c in ("width_m", "half_length_m", "radius_m"))
    return Palette(cutouts, width, half_length, radius, np.array([SYMBOLS.index(s) for s in table["symbol"]]))


def draw_items(rng: Rng, palette: Palette, lamps: list[Lamp], table: Top) -> list[tuple[Window, Drawn]]:
    """Draw the items, each with the window of the canvas that it fills; some are made of what tops are made of."""
    count = int(rng.choice(MAX_ITEMS + 1, p=COUNTS))
    if rng.random() < FULL_CHANCE:
        count = int(rng.integers(MOST + 1))
    near = NEAREST ** rng.random() if rng.random() < NEAR_CHANCE else 1.0
    aslant, bearing = rng.random() < ASLANT_CHANCE, rng.uniform(-np.pi, np.pi)
    slant = rng.uniform(*SLANT)
    gap = -OVERLAP_M * near if rng.random() < OVERLAP_CHANCE else MIN_GAP_M
    tight, tall = rng.random() < TIGHT_CHANCE, not aslant and rng.random() < 0.5
    segments, radii, placed = np.empty((0, 2, 2)), np.empty(0), []
    for _ in range(count):
        kind = "cutout" if rng.random() < CUTOUT_CHANCE else rng.choice(KINDS, p=SHARES)
        if aslant and rng.random() < STANDING_CHANCE:
            kind = "standing"
        scale = rng.uniform(0.7, 1.4) if rng.random() < 0.5 else rng.uniform(0.9, 1.1)
        index = int(rng.integers(len(palette.cutouts)))
        half, radius = size_of(rng, kind, scale * near, palette, index, slant)
        angle = bearing + rng.normal(0, 0.1) if kind == "standing" else None
        place = place_item(rng, half - radius, radius, segments, radii, tight, gap, angle)
        if place is None:
            continue
        centre, angle, segment = place
        segments, radii = np.concatenate([segments, segment[None]]), np.append(radii, radius)
        lean = np.zeros(2) if not tall else (centre - CANVAS_M / 2) * 0.06
        window, frame = frame_of(centre, angle, 1.3 * half + 0.01 + np.abs(lean).max(), lamps[0])
        to_item = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        if kind == "cutout":
            item = cut_out(rng, palette, index, scale * near, frame)._replace(look=LOOKS[palette.symbol[index]])
        elif kind == "glass":
            item = draw.clear_glass(rng, frame, radius, to_item @ lean)
        elif kind in ("standing", "lying"):
            item = draw.revolved(rng, frame, half, radius, kind == "lying", rng.random() < CLEAR_CHANCE)
        elif kind in ("cutlery", "box", "tool"):
            item = {"cutlery": draw.cutlery, "box": draw.box, "tool": draw.tool}[kind](rng, frame, half, radius)
        else:
            item = (draw.mug if kind == "mug" else draw.crockery)(rng, frame, radius)
        item = item._replace(height_m=item.height_m * near)
        if item.bend_m is not None:
            item = item._replace(bend_m=item.bend_m @ to_item)
        elif rng.random() < RESURFACED_CHANCE:
            item = resurfaced(rng, item, table)
        placed.append((window, item))
    return placed


def resurfaced(rng: Rng, item: Drawn, table: Top) -> Drawn:
    """Return an item that is hard to see: translucent, of the table's colour, or of a material of tables."""
    kind = rng.random()
    if kind < 0.3:
        share = np.float32(rng.uniform(0.3, 0.85))
        return item._replace(alpha=item.alpha * share, blocks=item.blocks * share)
    if kind < 0.65:
        shade = item.rgb[item.silhouette].mean(0) if item.silhouette.any() else np.ones(3)
        likeness = table[::16, ::16].mean((0, 1)) * rng.normal(1, 0.1) / np.maximum(shade, 0.05)
        return item._replace(rgb=(item.rgb * np.minimum(likeness, 4)).astype(np.float32))
    rows, columns = item.alpha.shape
    side = int(rng.uniform(60, len(table)))
    left, up = rng.integers(0, len(table) - side + 1, 2)
    swatch = cv2.resize(table[up : up + side, left : left + side], (columns, rows), interpolation=cv2.INTER_AREA)
    swatch = swatch[..., rng.permutation(3)] if rng.random() < 0.6 else swatch
    mean = float(item.rgb[item.silhouette].mean()) if item.silhouette.any() else 1.0
    light = item.rgb.mean(2, keepdims=True) / max(mean, 0.05)
    return item._replace(rgb=(swatch * light * np.float32(rng.uniform(0.6, 1.4))).astype(np.float32))


def size_of(rng: Rng, kind: str, scale: float, palette: Palette, index: int, slant: float) -> tuple[float, float]:
    """Return an item's half-length, ends included, and the radius of its footprint [m]; slant: lean over height."""
    if kind == "cutout":
        radius = palette.radius_m[index] * scale
        return float(palette.half_length_m[index] * scale + radius), float(radius)
    if kind == "cutlery":
        return rng.uniform(0.08, 0.1) * scale, 0.013 * rng.uniform(0.7, 1.4) * max(scale, 1)
    if kind == "tool":
        return rng.uniform(0.04, 0.11) * scale, rng.uniform(0.012, 0.035) * scale
    if kind == "standing":
        radius = rng.uniform(0.025, 0.05) * scale
        return radius + min(rng.uniform(0.06, 0.25) * scale * slant, MAX_LEAN_M) / 2, radius
    if kind == "lying":
        half = rng.uniform(0.04, 0.12) * scale
        return half, half * rng.uniform(0.2, 0.6)
    if kind == "box":
        half = rng.uniform(0.05, 0.09) * scale
        return half, half * rng.uniform(0.4, 1)
    dish = (0.085, 0.14) if rng.random() < 0.25 else (0.055, 0.085)
    radius = rng.uniform(*{"glass": (0.038, 0.05), "mug": (0.045, 0.065), "crockery": dish}[kind]) * scale
    return radius, radius


def place_item(
    rng: Rng, half: float, radius: float, segments: Array, radii: Array, tight: bool, least: float, angle: float | None
) -> tuple[Array, float, Array] | None:
    """Return a free place: centre [m] on the canvas, angle and segment; None if there is none.

    least: smallest gap to others [m]; angle: of the item, None for a random one.
    """
    low = -0.02 if rng.random() < 0.15 else 0.1
    centres = rng.uniform(low, CANVAS_M - low, (PLACES, 2))
    angles = rng.uniform(-np.pi, np.pi, PLACES) if angle is None else np.full(PLACES, angle)
    arms = np.stack([np.cos(angles), np.sin(angles)], -1) * half
    places = np.stack([centres - arms, centres + arms], 1)
    if not len(radii):
        return centres[0], float(angles[0]), places[0]
    gaps = (segment_distance(places[:, None], segments[None]) - radii).min(1) - radius
    free = np.flatnonzero(gaps > (least if tight or least < 0 else rng.choice([0.015, 0.03])))
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


def cut_out(rng: Rng, palette: Palette, index: int, scale: float, frame: Frame) -> Drawn:
    """Return a cut-out in its frame, with another tint, contrast and sometimes another decoration."""
    source, symbol = palette.cutouts[index], APPEARANCES[palette.symbol[index]]
    half, per_m = palette.width_m[index] * scale / 2, np.float32(len(source) / (palette.width_m[index] * scale))
    columns, rows = (along * per_m + len(source) / 2 - 0.5 for along in (frame.x, frame.y))
    rgba = cv2.remap(source, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
    alpha = rgba[..., 3]
    rgb = rgba[..., :3] / np.maximum(alpha, 1e-3)[..., None]
    if rng.random() < 0.5:
        rgb = rgb[..., rng.permutation(3)]
    rgb = rgb ** np.float32(np.exp(rng.normal(0, 0.35))) * rng.normal(1, 0.15, 3).astype(np.float32)
    if rng.random() < 0.25 and not symbol.transparent:
        rgb = rgb * (draw.decorated(rng, frame.x, frame.y, max(half, 0.02)) + 0.15)
    towards = (frame.x * frame.lamp[0] + frame.y * frame.lamp[1]) / half
    rgb = rgb * (1 - rng.uniform(0, 2) * symbol.concavity * np.clip(towards, -1, 1))[..., None]
    height = symbol.height_m * rng.uniform(0.5, 5)
    if not symbol.transparent:
        return Drawn(rgb.astype(np.float32), alpha, alpha > 0.5, height, alpha)
    outline, _ = cv2.findContours((alpha > 0.05).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    filled = cv2.drawContours(np.zeros(alpha.shape, np.uint8), outline, -1, 1, cv2.FILLED).astype(bool)
    blocks = np.minimum(alpha * rng.uniform(1, 4), 1)
    alpha = alpha * np.float32(rng.uniform(0.4, 1))
    pull = np.float32(rng.uniform(-0.6, 0.3)) * filled
    bend = np.stack([frame.x * pull, frame.y * pull], -1)
    return Drawn(rgb.astype(np.float32), alpha, filled, height * 2, blocks, bend)
