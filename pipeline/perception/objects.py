"""Detect the objects in a table image, and fit a capsule to each.

The segmenter marks the items' pixels (segmenter.py), and OpenCV turns its maps into one outline an item, on a grid
finer than the image. To each outline a capsule is fitted, all points within `radius` of a segment, with features that
tell glasses from bowls, plates and cutlery.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt
from scipy.special import entr
from torch import Tensor

from pipeline.perception.segmenter import STRIDE, Maps, segment
from pipeline.world.layout import SIDE

SUPERSAMPLING = 4  # grid points per pixel along each axis
OUTLINE = 0.35  # probability on an outline: at .5 some handles are missed (validation)
MIN_ITEM_PX = 12  # smaller regions are no items [pixels of the image]: a teaspoon has 40
MIN_CORE_PX = 3  # smallest part that is an item of its own where items touch [pixels of the image]
SQUARE = np.ones((3, 3), np.uint8)  # a pixel and its neighbours
FEATURES = ("area", "elongation", "length", "width", "see-through", "contrast")  # logarithms; see-through as log-odds
MAX_OBJECTS = 12  # largest number of objects per image; the largest objects are kept
SURE = 0.02  # probabilities of see-through are kept this far from 0 and 1, so that log-odds stay comparable
MIN_CONTRAST = 1 / 255  # smallest mean difference from the table's colour [1 = white]
# Mean squared distance of an object's pixels from their neighbours' mean, over the pixels' variance. Shuffled pixels
# reach 1.25. The threshold was chosen against the placebo of the refutation study, so that study cannot judge it.
MAX_TEXTURE_DISORDER = 0.75
NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4  # mean over a pixel's four neighbours
FineMask = UInt8[Array, "fine_row fine_column"]  # values 0 or 1

cv2.setNumThreads(1)  # stages run one process per core

MIN_LONG_ELONGATION = 2.5  # ratio of variances along and across above which an object's ends determine its length

# A capsule of radius 1 and half-length l has the ratio ELONGATIONS(l) of variances along and across it.
_LENGTHS = np.linspace(0, 20, 2001)
_ELONGATIONS = (4 / 3 * _LENGTHS**3 + np.pi * _LENGTHS**2 + 8 / 3 * _LENGTHS + np.pi / 4) / (
    4 / 3 * _LENGTHS + np.pi / 4
)


class Capsule(NamedTuple):
    """A fitted capsule, with the moments of the points that it was fitted to."""

    centre: Float[Array, "2"]  # [m]
    half: Float[Array, "2"]  # of the segment: from the centre to one end [m]
    radius: float  # [m]
    area: float  # area of the points [m^2]
    elongation: float  # variance along the points' long axis over the variance across it


def fit_capsule(points: Float[Array, "point 2"], per_metre: int) -> Capsule:
    """Return the capsule with the same area and moments as points [m] on a grid of `per_metre` points per metre.

    Above MIN_LONG_ELONGATION the object's ends determine the length: most cutlery is no capsule, and moments
    underestimate its length.
    """
    centre = points.mean(0)
    values, vectors = np.linalg.eigh((points - centre).T @ (points - centre) / len(points))
    elongation, axis = float(values[1] / values[0]), vectors[:, 1]
    area = len(points) / per_metre**2
    if elongation <= MIN_LONG_ELONGATION:
        length = np.interp(elongation, _ELONGATIONS, _LENGTHS)
        radius = float(np.sqrt(area / (np.pi + 4 * length)))
        return Capsule(centre, length * radius * axis, radius, area, elongation)
    along = (points - centre) @ axis
    extent = max(np.ptp(along) + 1 / per_metre, 2 * np.sqrt(area / np.pi))
    radius = float((extent - np.sqrt(extent**2 - (4 - np.pi) * area)) / (4 - np.pi))
    middle = centre + (along.min() + along.max()) / 2 * axis
    return Capsule(middle, (extent / 2 - radius) * axis, radius, area, elongation)


@dataclass(frozen=True)
class Objects:
    """Detected objects per scene, largest first, padded to MAX_OBJECTS."""

    ends: Float32[Array, "scene object 2 2"]  # end points of each capsule's segment [m]
    radius: Float32[Array, "scene object"]  # of each capsule [m]
    features: Float32[Array, "scene object feature"]
    present: Bool[Array, "scene object"]
    doubt: Float32[Array, " scene"]  # how unsure the detector is of each picture (`doubt`)


def detect_objects(
    images: Float[Tensor, "scene 3 100 100"], empty: Float[Tensor, "scene 3 100 100"] | None = None
) -> Objects:
    """Return the objects detected in each image [1 = white]; images do not affect each other.

    `empty`: pictures of the same tables without items, from the same camera in the same light, where there are any.
    """
    objects = Objects(
        np.zeros((len(images), MAX_OBJECTS, 2, 2), np.float32),
        np.zeros((len(images), MAX_OBJECTS), np.float32),
        np.zeros((len(images), MAX_OBJECTS, len(FEATURES)), np.float32),
        np.zeros((len(images), MAX_OBJECTS), bool),
        np.zeros(len(images), np.float32),
    )
    tables = [None] * len(images) if empty is None else to_bytes(empty)
    for scene, (image, table) in enumerate(zip(to_bytes(images), tables, strict=True)):
        found, objects.doubt[scene] = _detect(image, table)
        for i, (ends, radius, features) in enumerate(found):
            objects.ends[scene, i], objects.radius[scene, i] = ends, radius
            objects.features[scene, i], objects.present[scene, i] = features, True
    return objects


def to_bytes(images: Float[Tensor, "scene 3 100 100"]) -> list[bytes]:
    """Return each image's 8-bit pixels in row order, as bytes: the inverse of `pipeline.models.base.to_tensor`."""
    pixels = images.detach().permute(0, 2, 3, 1).mul(255).round().to(torch.uint8).contiguous().numpy()
    return [image.tobytes() for image in pixels]


def _pixels(image: bytes) -> UInt8[Array, "100 100 3"]:
    return np.frombuffer(image, np.uint8).reshape(SIDE, SIDE, 3)


@lru_cache(maxsize=4096)  # 30 kB each; all models use the same images
def _detect(image: bytes, table: bytes | None) -> tuple[list[tuple[Array, float, Array]], float]:
    """Return the MAX_OBJECTS largest objects in an 8-bit RGB image, as in `Objects`, and the doubt about the image."""
    pixels = _pixels(image)
    maps = segment(pixels, None if table is None else _pixels(table))
    typical = np.median(pixels[::STRIDE, ::STRIDE], axis=(0, 1))
    contrast = np.linalg.norm(pixels - typical.astype(np.float32), axis=-1) / 255
    colours = pixels.astype(np.float32)
    unlike = ((colours - cv2.filter2D(colours, -1, NEIGHBOURS, borderType=cv2.BORDER_REPLICATE)) ** 2).sum(-1)
    unlike -= np.median(unlike)  # the table's own disorder
    objects = []
    for outline in find_outlines(maps):
        rows, columns = np.nonzero(outline.mask)
        y, x = (outline.row + rows + 0.5) / SUPERSAMPLING, (outline.column + columns + 0.5) / SUPERSAMPLING  # [pixels]
        covered, mask = (y.astype(int), x.astype(int)), np.zeros((SIDE, SIDE), np.uint8)
        mask[covered] = 1
        around = cv2.dilate(mask, SQUARE) > 0
        if unlike[around].mean() / colours[around].var(0).sum() >= MAX_TEXTURE_DISORDER:
            continue
        capsule = fit_capsule(np.stack([x, SIDE - y], -1) / SIDE, SUPERSAMPLING * SIDE)
        share = np.clip(maps.see_through[covered].mean(), SURE, 1 - SURE)
        length = 2 * (np.linalg.norm(capsule.half) + capsule.radius)
        sizes = np.log(np.array([capsule.area, capsule.elongation, length, 2 * capsule.radius]))
        seen = [np.log(share / (1 - share)), np.log(max(float(contrast[covered].mean()), MIN_CONTRAST))]
        ends = np.stack([capsule.centre - capsule.half, capsule.centre + capsule.half])
        objects.append((ends, capsule.radius, np.array([*sizes, *seen])))
    return sorted(objects, key=lambda object_: -object_[2][0])[:MAX_OBJECTS], doubt(maps.item)


class Outline(NamedTuple):
    """One item."""

    mask: FineMask  # within its bounding box
    row: int  # of the box's corner on the finer grid
    column: int


def find_outlines(maps: Maps) -> list[Outline]:
    """Return the items: regions whose probability exceeds OUTLINE, cut where two items are close, holes filled."""
    size = SUPERSAMPLING * SIDE, SUPERSAMPLING * SIDE
    item, between = (cv2.resize(x, size, interpolation=cv2.INTER_LINEAR) for x in (maps.item, maps.between))
    inside = item > OUTLINE
    apart = between < OUTLINE if (maps.between > OUTLINE).any() else inside
    cores = (inside & apart).astype(np.uint8)
    regions = cv2.connectedComponentsWithStats(inside.astype(np.uint8), connectivity=4)
    outlines = []
    for label in range(1, regions[0]):
        column, row, width, height, area = regions[2][label]
        if area >= MIN_ITEM_PX * SUPERSAMPLING**2:
            window = slice(row, row + height), slice(column, column + width)
            region = (regions[1][window] == label).astype(np.uint8)
            for mask in _cut(region, cores[window] & region):
                contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
                filled = cv2.drawContours(np.zeros_like(mask), contours, -1, 1, cv2.FILLED)
                outlines.append(Outline(filled, int(row), int(column)))
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


def doubt(item: Float32[Array, "row column"]) -> float:
    """Return the entropy [nat] of an item map over the length of its outlines [pixels] (docs/decisions/031-doubt.md).

    Every outline has unsure pixels, so a picture of more items may be less sure. Blur and noise widen outlines, and
    items that are almost missed add unsure pixels without an outline. A table without items counts as MIN_ITEM_PX.
    """
    inside = (item > OUTLINE).astype(np.uint8)
    length = int((cv2.dilate(inside, SQUARE) - inside).sum())
    return float((entr(item) + entr(1 - item)).sum() / max(length, MIN_ITEM_PX))
