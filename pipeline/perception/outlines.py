"""Turn the segmenter's maps into one mask an item, on a grid finer than the image, and measure how unsure they are."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float32, UInt8
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt
from scipy.special import entr

from pipeline.perception.segmenter import Maps

SUPERSAMPLING = 4  # grid points per pixel along each axis
OUTLINE = 0.35  # probability on an outline: at .5 some handles are missed (validation)
MIN_ITEM_PX = 12  # smaller regions are no items [pixels of the image]: a teaspoon has 40
MIN_CORE_PX = 3  # smallest part that is an item of its own where items touch [pixels of the image]
SQUARE = np.ones((3, 3), np.uint8)  # a pixel and its neighbours

FineMask = UInt8[Array, "fine_row fine_column"]  # values 0 or 1


class Outline(NamedTuple):
    """One item."""

    mask: FineMask  # within its bounding box
    row: int  # of the box's corner on the finer grid
    column: int


def find_outlines(maps: Maps) -> list[Outline]:
    """Return the items: regions whose probability exceeds OUTLINE, cut where two items are close, holes filled."""
    inside = _finer(maps.item) > OUTLINE
    apart = _finer(maps.between) < OUTLINE if (maps.between > OUTLINE).any() else inside
    cores = (inside & apart).astype(np.uint8)
    regions = cv2.connectedComponentsWithStats(inside.astype(np.uint8), connectivity=4)
    outlines = []
    for label in range(1, regions[0]):
        column, row, width, height, area = regions[2][label]
        if area >= MIN_ITEM_PX * SUPERSAMPLING**2:
            window = slice(row, row + height), slice(column, column + width)
            region = (regions[1][window] == label).astype(np.uint8)
            masks = _cut(region, cores[window] & region)
            outlines += [Outline(_filled(mask), int(row), int(column)) for mask in masks]
    return [o for o in outlines if o.mask.sum() >= MIN_ITEM_PX * SUPERSAMPLING**2]


def _cut(region: FineMask, cores: FineMask) -> list[FineMask]:
    """Return a region's parts: each point belongs to the nearest core, if there are several."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(cores, connectivity=4)
    large = [i for i in range(1, count) if stats[i, cv2.CC_STAT_AREA] >= MIN_CORE_PX * SUPERSAMPLING**2]
    if len(large) < 2:
        return [region]
    # Not OpenCV's distances: how they round can depend on where an array lies in memory
    nearest = np.argmin([distance_transform_edt(labels != i) for i in large], axis=0)
    return [region & (nearest == i).astype(np.uint8) for i in range(len(large))]


def _finer(values: Float32[Array, "row column"]) -> Float32[Array, "fine_row fine_column"]:
    return cv2.resize(values, None, fx=SUPERSAMPLING, fy=SUPERSAMPLING, interpolation=cv2.INTER_LINEAR)


def _filled(mask: FineMask) -> FineMask:
    """Return a mask with its holes filled."""
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(np.zeros_like(mask), contours, -1, 1, cv2.FILLED)


def doubt(item: Float32[Array, "row column"]) -> float:
    """Return the entropy [nat] of an item map over the length of its outlines [pixels] (docs/decisions/031-doubt.md).

    Every outline has unsure pixels, so a picture of more items may be less sure. Blur and noise widen outlines, and
    items that are almost missed add unsure pixels without an outline. A table without items counts as MIN_ITEM_PX.
    """
    inside = (item > OUTLINE).astype(np.uint8)
    length = int((cv2.dilate(inside, SQUARE) - inside).sum())
    return float((entr(item) + entr(1 - item)).sum() / max(length, MIN_ITEM_PX))
