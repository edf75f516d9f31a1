"""Fit a capsule to the points of an outlined object: the points within `radius` of a segment.

A capsule is how robots commonly bound objects.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

MIN_LONG_ELONGATION = 2.5  # variance along over across from which an object's ends give its length

# A capsule of radius 1 and half-length l has the variances ratio ELONGATIONS(l), along to across.
_LENGTHS = np.linspace(0, 20, 2001)
_ELONGATIONS = (4 / 3 * _LENGTHS**3 + np.pi * _LENGTHS**2 + 8 / 3 * _LENGTHS + np.pi / 4) / (
    4 / 3 * _LENGTHS + np.pi / 4
)


class Capsule(NamedTuple):
    """A fitted capsule and the moments of the points behind it."""

    centre: Float[Array, "2"]  # [m]
    half: Float[Array, "2"]  # of the segment, from the centre to one end [m]
    radius: float  # [m]
    area: float  # of the points [m^2]
    elongation: float  # variance along the points' long axis over that across it


def fit_capsule(points: Float[Array, "point 2"], per_metre: int) -> Capsule:
    """Fit the capsule of the same area and moments as points [m] on a grid of `per_metre` points a metre.

    An object more elongated than MIN_LONG_ELONGATION gets its length from its ends, since most pieces of cutlery are
    no capsules and moments make them short.
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


def overlap(points: Float[Array, "point 2"], capsule: Capsule, per_metre: int) -> float:
    """Return the intersection over union of points [m] on a grid of `per_metre` points a metre and a capsule."""
    offsets, half, radius = points - capsule.centre, capsule.half, capsule.radius
    share = np.clip(offsets @ half / max(half @ half, 1e-12), -1, 1)
    inside = np.linalg.norm(offsets - share[:, None] * half, axis=1) <= radius
    intersection = inside.sum() / per_metre**2
    union = len(points) / per_metre**2 + np.pi * radius**2 + 4 * radius * np.linalg.norm(half) - intersection
    return float(intersection / union)
