"""Detect the objects in a table image, and fit a capsule to each.

The segmenter marks the items' pixels (segmenter.py), and OpenCV turns its maps into outlines (outlines.py). To each
outline a capsule is fitted (capsule.py), with features that tell glasses from bowls, plates and cutlery.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray as Array
from torch import Tensor

from pipeline.perception.capsule import fit_capsule
from pipeline.perception.outlines import SQUARE, SUPERSAMPLING, Outline, doubt, find_outlines
from pipeline.perception.segmenter import STRIDE, segment
from pipeline.world.layout import SIDE

FEATURES = ("area", "elongation", "length", "width", "see-through", "contrast")  # logarithms; see-through as log-odds
MAX_OBJECTS = 12  # largest number of objects per image; the largest objects are kept
SURE = 0.02  # probabilities of see-through are kept this far from 0 and 1, so that log-odds stay comparable
MIN_CONTRAST = 1 / 255  # smallest mean difference from the table's colour [1 = white]
# Mean squared distance of an object's pixels from their neighbours' mean, over the pixels' variance. Shuffled pixels
# reach 1.25. The threshold was chosen against the placebo of the refutation study, so that study cannot judge it.
MAX_TEXTURE_DISORDER = 0.75
NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4  # mean over a pixel's four neighbours

cv2.setNumThreads(1)  # stages run one process per core


@dataclass(frozen=True)
class Objects:
    """Detected objects per scene, largest first, padded to MAX_OBJECTS."""

    ends: Float32[Array, "scene object 2 2"]  # end points of each capsule's segment [m]
    radius: Float32[Array, "scene object"]  # of each capsule [m]
    features: Float32[Array, "scene object feature"]
    present: Bool[Array, "scene object"]
    doubt: Float32[Array, " scene"]  # how unsure the detector is of each picture (pipeline.perception.outlines.doubt)


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
        for i, object_ in enumerate(found):
            objects.ends[scene, i], objects.radius[scene, i] = object_.ends, object_.radius
            objects.features[scene, i], objects.present[scene, i] = object_.features, True
    return objects


class _Object(NamedTuple):
    ends: Float[Array, "2 2"]  # end points of the capsule's segment [m]
    radius: float  # of the capsule [m]
    features: Float[Array, " feature"]


def to_bytes(images: Float[Tensor, "scene 3 100 100"]) -> list[bytes]:
    """Return each image's 8-bit pixels in row order, as bytes: the inverse of `pipeline.models.base.to_tensor`."""
    pixels = images.detach().permute(0, 2, 3, 1).mul(255).round().to(torch.uint8).contiguous().numpy()
    return [image.tobytes() for image in pixels]


@lru_cache(maxsize=4096)  # 30 kB each; all models use the same images
def _detect(image: bytes, table: bytes | None) -> tuple[list[_Object], float]:
    """Return the MAX_OBJECTS largest objects in an 8-bit RGB image, the largest first, and the doubt about it."""
    pixels = _pixels(image)
    maps = segment(pixels, None if table is None else _pixels(table))
    typical = np.median(pixels[::STRIDE, ::STRIDE], axis=(0, 1))
    contrast = np.linalg.norm(pixels - typical.astype(np.float32), axis=-1) / 255
    outlines = find_outlines(maps)
    ordered = [
        outline
        for outline, d in zip(outlines, disorder(outlines, pixels), strict=True)
        if not d >= MAX_TEXTURE_DISORDER
    ]
    objects = [describe(outline, maps.see_through, contrast) for outline in ordered]
    return sorted(objects, key=lambda object_: -object_.features[0])[:MAX_OBJECTS], doubt(maps.item)


def _pixels(image: bytes) -> UInt8[Array, "100 100 3"]:
    return np.frombuffer(image, np.uint8).reshape(SIDE, SIDE, 3)


def _points(outline: Outline) -> tuple[Float[Array, " point"], Float[Array, " point"]]:
    """Return rows and columns of an outline's points, both in pixels."""
    rows, columns = np.nonzero(outline.mask)
    return (outline.row + rows + 0.5) / SUPERSAMPLING, (outline.column + columns + 0.5) / SUPERSAMPLING


def disorder(outlines: list[Outline], image: UInt8[Array, "100 100 3"]) -> list[float]:
    """Return the disorder of each object's texture (MAX_TEXTURE_DISORDER), less the table's own."""
    colours = image.astype(np.float32)
    unlike = ((colours - cv2.filter2D(colours, -1, NEIGHBOURS, borderType=cv2.BORDER_REPLICATE)) ** 2).sum(-1)
    unlike, result = unlike - np.median(unlike), []
    for outline in outlines:
        mask = np.zeros((SIDE, SIDE), np.uint8)
        mask[tuple(axis.astype(int) for axis in _points(outline))] = 1
        covered = cv2.dilate(mask, SQUARE) > 0
        result.append(float(unlike[covered].mean() / colours[covered].var(0).sum()))
    return result


def describe(outline: Outline, see_through: Float32[Array, "100 100"], contrast: Float32[Array, "100 100"]) -> _Object:
    """Return an outlined item's capsule and features; `contrast`: each pixel's distance from the table's colour."""
    y, x = _points(outline)
    capsule = fit_capsule(np.stack([x, SIDE - y], -1) / SIDE, SUPERSAMPLING * SIDE)
    covered = y.astype(int), x.astype(int)
    share = np.clip(see_through[covered].mean(), SURE, 1 - SURE)
    length = 2 * (np.linalg.norm(capsule.half) + capsule.radius)
    sizes = np.log(np.array([capsule.area, capsule.elongation, length, 2 * capsule.radius]))
    seen = [np.log(share / (1 - share)), np.log(max(float(contrast[covered].mean()), MIN_CONTRAST))]
    ends = np.stack([capsule.centre - capsule.half, capsule.centre + capsule.half])
    return _Object(ends, capsule.radius, np.array([*sizes, *seen]))
