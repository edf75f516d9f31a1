"""Fit a capsule, all points within `radius` of a segment, to the points of an outlined object.

Robots commonly approximate objects by capsules for collision checking.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

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
