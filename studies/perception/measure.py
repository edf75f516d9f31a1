"""Compare detected objects with the truth: which items were found, how well they are outlined, what was made up."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array
from scipy.optimize import linear_sum_assignment

from pipeline.perception.capsule import fit_capsule
from pipeline.perception.objects import Objects
from pipeline.perception.outlines import SUPERSAMPLING
from pipeline.world.layout import SIDE, point_segment_distance

FOUND_IOU = 0.5  # intersection over union from which an item counts as found
MIN_VISIBLE_PX = 12  # items with fewer visible pixels are neither asked for nor made up
FINE = 2  # points per pixel along each axis on which areas are compared


class Matches(NamedTuple):
    """The best assignment of the detected objects of one picture to its items."""

    item: Int[Array, " item"]  # number of each item in `instances`
    iou: Float[Array, " item"]  # intersection over union with its object; 0 without one
    made_up: int  # objects without an item


def match(objects: Objects, scene: int, instances: UInt8[Array, "row column"]) -> Matches:
    """Return the assignment with the largest sum of intersections over unions.

    Objects are capsules, so an item counts as the capsule fitted to its true pixels.
    """
    items = [i for i in range(1, instances.max() + 1) if (instances == i).sum() >= MIN_VISIBLE_PX]
    capsules = [
        covered(objects.ends[scene, k], objects.radius[scene, k]) for k in np.flatnonzero(objects.present[scene])
    ]
    true = [_true_capsule(instances == i) for i in items]
    iou = np.array([[_iou(a, b) for b in capsules] for a in true]).reshape(len(items), len(capsules))
    rows, columns = linear_sum_assignment(-iou)
    best = np.zeros(len(items))
    best[rows] = iou[rows, columns]
    small = (instances > 0) & ~np.isin(instances, items)  # objects on the rest of a hidden item are no error
    fine_small = small.repeat(FINE, 0).repeat(FINE, 1)
    free = [
        c for k, c in enumerate(capsules) if k not in columns[iou[rows, columns] > 0] and not (c & fine_small).any()
    ]
    return Matches(np.array(items, int), best, len(free))


def covered(ends: Float[Array, "2 2"], radius: float) -> Bool[Array, "fine_row fine_column"]:
    """Return the points of the finer grid inside a capsule [m]."""
    place = (np.arange(SIDE * FINE) + 0.5) / (SIDE * FINE)
    points = np.stack(np.meshgrid(place, 1 - place), -1)
    return point_segment_distance(points, ends[0], ends[1]) < radius


def _true_capsule(mask: Bool[Array, "row column"]) -> Bool[Array, "fine_row fine_column"]:
    """Return the points inside the capsule fitted to an item's pixels."""
    rows, columns = np.nonzero(mask.repeat(SUPERSAMPLING, 0).repeat(SUPERSAMPLING, 1))
    points = np.stack([columns + 0.5, SIDE * SUPERSAMPLING - rows - 0.5], -1) / (SIDE * SUPERSAMPLING)
    capsule = fit_capsule(points, SIDE * SUPERSAMPLING)
    return covered(np.stack([capsule.centre - capsule.half, capsule.centre + capsule.half]), capsule.radius)


def _iou(a: Bool[Array, "row column"], b: Bool[Array, "row column"]) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))
