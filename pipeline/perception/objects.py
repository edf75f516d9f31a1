"""Detect the objects in a table image, and fit a capsule to each.

The segmenter marks the items' pixels (segmenter.py), and OpenCV turns its maps into one outline an item, on a grid
finer than the image. To each outline a capsule is fitted, all points within `radius` of a segment, with features that
tell glasses from bowls, plates and cutlery.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt
from scipy.special import entr

from pipeline.perception.background import Pixels
from pipeline.perception.segmenter import LOOKS, OUTLINE, STRIDE, Maps, segment
from pipeline.world.layout import SIDE
from pipeline.world.told import Told

SUPERSAMPLING = 4  # grid points per pixel along each axis
MIN_ITEM_PX = 12  # smaller regions are no items [pixels of the image]: a teaspoon has 40
SURE_ITEM = 0.6  # an item has a pixel at least so probable: on photographs fewer finds are parts or prints (validation)
MIN_CORE_PX = 3  # smallest part that is an item of its own where items touch [pixels of the image]
SQUARE = np.ones((3, 3), np.uint8)  # a pixel and its neighbours
FEATURES = ("area", "elongation", "length", "width", "see-through", "contrast")  # logarithms; see-through as log-odds
MAX_OBJECTS = 20  # largest number of objects per image; the largest objects are kept
SURE = 0.02  # probabilities of see-through are kept this far from 0 and 1, so that log-odds stay comparable
MIN_CONTRAST = 1 / 255  # smallest mean difference from the table's colour [1 = white]
# Mean squared distance of an object's pixels from their neighbours' mean, over the pixels' variance. Shuffled pixels
# reach 1.25. The threshold was chosen against the placebo of the refutation study, so that study cannot judge it.
MAX_TEXTURE_DISORDER = 0.75
NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4  # mean over a pixel's four neighbours
FineMask = UInt8[Array, "fine_row fine_column"]  # values 0 or 1


MIN_LONG_ELONGATION = 2.5  # ratio of variances along and across above which an object's ends determine its length

# A capsule of radius 1 and half-length l has the ratio ELONGATIONS(l) of variances along and across it.
_L = np.linspace(0, 20, 2001)
_ELONGATIONS = (4 / 3 * _L**3 + np.pi * _L**2 + 8 / 3 * _L + np.pi / 4) / (4 / 3 * _L + np.pi / 4)


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
        length = np.interp(elongation, _ELONGATIONS, _L)
        radius = float(np.sqrt(area / (np.pi + 4 * length)))
        return Capsule(centre, length * radius * axis, radius, area, elongation)
    along = (points - centre) @ axis
    extent = max(np.ptp(along) + 1 / per_metre, 2 * np.sqrt(area / np.pi))
    radius = float((extent - np.sqrt(extent**2 - (4 - np.pi) * area)) / (4 - np.pi))
    middle = centre + (along.min() + along.max()) / 2 * axis
    return Capsule(middle, (extent / 2 - radius) * axis, radius, area, elongation)


@dataclass(frozen=True)
class Objects(Told):
    """Detected objects per scene, largest first, padded to MAX_OBJECTS."""

    ends: Float32[Array, "scene object 2 2"]  # end points of each capsule's segment [m]
    radius: Float32[Array, "scene object"]  # of each capsule [m]
    features: Float32[Array, "scene object feature"]
    present: Bool[Array, "scene object"]
    doubt: Float32[Array, " scene"]  # how unsure the detector is of each picture (`doubt`)
    kinds: Float32[Array, "scene object kind"]  # further features: what each object is, if that is asked or told

    def __len__(self) -> int:
        """Return the number of scenes."""
        return len(self.doubt)

    def __getitem__(self, scenes: Array | slice | list[int]) -> "Objects":
        """Return some of the scenes."""
        return Objects(*(getattr(self, field.name)[scenes] for field in fields(self)))

    @classmethod
    def of(cls, scenes: Sequence["Sequence[Object]"], doubt: Sequence[float], kinds: int = len(LOOKS)) -> "Objects":
        """Return the objects of each scene, the MAX_OBJECTS largest ones, with the first `kinds` of their looks."""
        shape = len(scenes), MAX_OBJECTS
        objects = cls(
            np.zeros((*shape, 2, 2), np.float32),
            np.zeros(shape, np.float32),
            np.zeros((*shape, len(FEATURES)), np.float32),
            np.zeros(shape, bool),
            np.array(doubt, np.float32),
            np.zeros((*shape, kinds), np.float32),
        )
        for scene, found in enumerate(scenes):
            for i, one in enumerate(sorted(found, key=lambda one: -one.features[0])[:MAX_OBJECTS]):
                objects.ends[scene, i], objects.radius[scene, i], objects.present[scene, i] = one.ends, one.radius, True
                objects.features[scene, i], objects.kinds[scene, i] = one.features, one.looks[:kinds]
        return objects


class Object(NamedTuple):
    """One object, as a picture shows it within its outline."""

    ends: Float[Array, "2 2"]  # end points of the capsule's segment [m]
    radius: float  # of the capsule [m]
    features: Float[Array, " feature"]  # FEATURES
    looks: Float32[Array, " look"]  # probability of each of LOOKS


def detect_objects(images: Pixels, empty: Pixels | None = None, looks: bool = False) -> Objects:
    """Return the objects detected in each image [1 = white]; images do not affect each other.

    `empty`: pictures of the same tables without items, from the same camera in the same light, where there are any.
    looks: say what each object looks like, as its `kinds` (LOOKS).
    """
    tables = [None] * len(images) if empty is None else to_bytes(empty)
    found = [_detect(image, table) for image, table in zip(to_bytes(images), tables, strict=True)]
    return Objects.of([objects for objects, _ in found], [doubt for _, doubt in found], len(LOOKS) if looks else 0)


def describe_outlined(image: UInt8[Array, "100 100 3"], outlines: "Sequence[Outline]") -> list[Object]:
    """Return the objects within given outlines, as the image shows them."""
    picture = _Picture(image, segment(image))
    return [picture.describe(outline) for outline in outlines]


def to_bytes(images: Pixels) -> list[bytes]:
    """Return each image's 8-bit pixels in row order, as bytes: the inverse of `pipeline.models.base.to_tensor`."""
    pixels = images.detach().permute(0, 2, 3, 1).mul(255).round().to(torch.uint8).contiguous().numpy()
    return [image.tobytes() for image in pixels]


def _pixels(image: bytes) -> UInt8[Array, "100 100 3"]:
    return np.frombuffer(image, np.uint8).reshape(SIDE, SIDE, 3)


class _Picture:
    """Hold an image and all that its objects are described by."""

    def __init__(self, pixels: UInt8[Array, "100 100 3"], maps: Maps):
        typical = np.median(pixels[::STRIDE, ::STRIDE], axis=(0, 1))
        self.maps, self.colours = maps, pixels.astype(np.float32)
        self.contrast = np.linalg.norm(pixels - typical.astype(np.float32), axis=-1) / 255
        mean = cv2.filter2D(self.colours, -1, NEIGHBOURS, borderType=cv2.BORDER_REPLICATE)
        self.unlike = ((self.colours - mean) ** 2).sum(-1)
        self.unlike -= np.median(self.unlike)  # the table's own disorder

    def is_noise(self, outline: "Outline") -> bool:
        """Return whether the pixels in and beside an outline are in no order, as no object's are."""
        mask, (x, y) = np.zeros((SIDE, SIDE), np.uint8), outline.points()
        mask[y.astype(int), x.astype(int)] = 1
        around = cv2.dilate(mask, SQUARE) > 0
        return bool(self.unlike[around].mean() / self.colours[around].var(0).sum() >= MAX_TEXTURE_DISORDER)

    def describe(self, outline: "Outline") -> Object:
        """Return the object within an outline."""
        x, y = outline.points()
        covered = y.astype(int), x.astype(int)
        capsule = fit_capsule(np.stack([x, SIDE - y], -1) / SIDE, SUPERSAMPLING * SIDE)
        share = np.clip(self.maps.see_through[covered].mean(), SURE, 1 - SURE)
        length = 2 * (np.linalg.norm(capsule.half) + capsule.radius)
        sizes = np.log(np.array([capsule.area, capsule.elongation, length, 2 * capsule.radius]))
        seen = [np.log(share / (1 - share)), np.log(max(float(self.contrast[covered].mean()), MIN_CONTRAST))]
        ends = np.stack([capsule.centre - capsule.half, capsule.centre + capsule.half])
        return Object(ends, capsule.radius, np.array([*sizes, *seen]), self.maps.looks[:, *covered].mean(1))


@lru_cache(maxsize=4096)  # 30 kB each; all models use the same images
def _detect(image: bytes, table: bytes | None) -> tuple[list[Object], float]:
    """Return the objects in an 8-bit RGB image, and the doubt about it."""
    pixels = _pixels(image)
    maps = segment(pixels, None if table is None else _pixels(table))
    picture = _Picture(pixels, maps)
    outlines = [outline for outline in find_outlines(maps) if not picture.is_noise(outline)]
    return list(map(picture.describe, outlines)), doubt(maps.item)


class Outline(NamedTuple):
    """One item."""

    mask: FineMask  # within its bounding box
    row: int  # of the box's corner on the finer grid
    column: int

    def points(self) -> tuple[Array, Array]:
        """Return x and y of its points [pixels of the image]."""
        rows, columns = np.nonzero(self.mask)
        return (self.column + columns + 0.5) / SUPERSAMPLING, (self.row + rows + 0.5) / SUPERSAMPLING


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
                if item[window][filled > 0].max() >= SURE_ITEM:
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
