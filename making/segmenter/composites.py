"""Draw training pictures for the segmenter: cut-outs and procedural items on procedural table tops.

Pictures are those of pipeline/world/render.py: 100 x 100 pixels of a 1 m table, drawn at twice that resolution.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from making.segmenter.camera import (
    CANVAS,
    PX_PER_M,
    Window,
    draw_camera,
    draw_illumination,
    draw_lamps,
    exposed,
    shadows,
)
from making.segmenter.items import Drawn
from making.segmenter.paint import SIDE_M, Top
from making.segmenter.placing import Palette as Palette
from making.segmenter.placing import draw_items
from making.segmenter.placing import read_palette as read_palette
from making.segmenter.tops import FAMILIES as FAMILIES
from making.segmenter.tops import draw_top
from making.segmenter.tops import family_names as family_names
from pipeline.world.layout import SIDE

TOP = round(SIDE_M * PX_PER_M)  # side of a drawn top [pixels]
SEE_THROUGH = 0.5  # mean alpha below which an item lets the table show through
TOP_USES = 2  # scenes that share a drawn top, each with a turn, tint and light of its own


class Composites(NamedTuple):
    """A batch of pictures and what is on them."""

    images: UInt8[Array, "n 100 100 3"]
    instances: UInt8[Array, "n 100 100"]  # 0 is table, shadows included; 1.. are items
    empty: UInt8[Array, "n 100 100 3"]  # the same table, light and camera without items
    family: Array  # names of the tops' families (n,)
    see_through: UInt8[Array, "n 100 100"]  # 1 where the item there lets the table show through


def draw_composites(rng: np.random.Generator, n: int, families: Sequence[str], palette: Palette) -> Composites:
    """Draw `n` pictures on tops of the named families with 0 to 6 items each.

    Raises ValueError for an unknown family.
    """
    if unknown := sorted(set(families) - set(FAMILIES)):
        raise ValueError(f"unknown families {unknown}: expected names from {sorted(FAMILIES)}")
    images, empty = np.empty((2, n, SIDE, SIDE, 3), np.uint8)
    instances, see_through = np.empty((2, n, SIDE, SIDE), np.uint8)
    names: list[str] = []
    for scene in range(n):
        if scene % TOP_USES == 0:
            name, top = draw_top(rng, families, TOP)
        names.append(name)
        images[scene], instances[scene], empty[scene], see_through[scene] = draw_scene(rng, top, palette)
    return Composites(images, instances, empty, np.array(names), see_through)


def draw_scene(rng: np.random.Generator, top: Top, palette: Palette) -> tuple[Array, Array, Array, Array]:
    """Draw one scene on a top; return its picture, instances, picture without items and see-through pixels."""
    table = turned(rng, top)
    lamps = draw_lamps(rng)
    illumination = draw_illumination(rng, lamps)
    illumination *= np.float32(exposed(rng, table, illumination))
    windows, drawn = draw_items(rng, palette, lamps, table)
    light = shadows(windows, drawn, lamps, rng)
    scene = table * light
    labels, clear = np.zeros((2, CANVAS, CANVAS), np.uint8)
    for k, (window, item) in enumerate(zip(windows, drawn, strict=True), 1):
        cover(scene, window, item)
        labels[window][item.silhouette] = k
        clear[window][item.silhouette] = item.alpha[item.silhouette].sum() < SEE_THROUGH * item.silhouette.sum()
    camera = draw_camera(rng)
    image, empty = (camera.take(rng, lit * illumination) for lit in (scene, table))
    instances = camera.label(labels, len(drawn))
    return image, instances, empty, camera.label(clear, 1) * (instances > 0)


def turned(rng: np.random.Generator, top: Top) -> Top:
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
        seen = cv2.remap(
            scene, x.astype(np.float32), y.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT
        )
        part = np.where(item.silhouette[..., None], seen, part)
    scene[window] = part + (item.rgb - part) * item.alpha[..., None]
