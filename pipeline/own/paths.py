"""Fit a Bezier path to each demonstration, and ask by cross-validation whether one control point is enough.

The models take paths of degree 2. A demonstration needs more if cross-validation over its samples picks a higher degree
and a parabola misses the hand by more than a pixel of the model's image.
"""

from itertools import pairwise
from math import comb

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.models.base import Z_RANGE_M
from pipeline.own.csv_files import DEMONSTRATIONS, KEY, Faults
from pipeline.own.frame import Frame
from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.bezier_fit import fit
from pipeline.world.layout import SIDE

DEGREES = (2, 3, 4, 5)
POINTS = 40  # points of a demonstration, equally far apart, that cross-validation uses
FOLDS = 5  # each holds two stretches of the path
CURVE_POINTS = 65  # points of a curve among which the nearest is searched
ROUNDS = 8  # of assigning points to places on the curve
DAMPING = 1e-4  # added to the normal equations' diagonal: what the points leave open stays as it is
POOR_ABOVE_M = 1 / SIDE  # a pixel of the model's image [m]


def fit_demonstrations(samples: pd.DataFrame, frame: Frame, faults: Faults) -> pd.DataFrame:
    """Return one row for each demonstration of `demonstrations.read_samples`, sorted by scene, user and demo.

    Columns: scene, user, demo, valid, z_x, z_y (control point in the model's metres), residual_m (root mean square
    distance from the path, metres on the table), degree (picked by cross-validation), needs_more, and held_out_2 to
    held_out_5 (residuals [m] on held-out stretches, by degree). Adds a fault for paths out of the models' range.
    """
    offsets = np.append(np.flatnonzero(~samples.duplicated(KEY)), len(samples))
    points = frame.to_model(samples[["x", "y"]].to_numpy())
    fits = fit(points, offsets, poor_above_m=POOR_ABOVE_M)
    demos = samples.iloc[offsets[:-1]]
    far = demos[(np.abs(fits.z_theta - np.mean(Z_RANGE_M)) > np.ptp(Z_RANGE_M) / 2).any(axis=1)]
    faults.rows(
        DEMONSTRATIONS, far, "demonstration ({name}) swings out farther than the models' paths can: leave it out"
    )
    demos = demos[[*KEY, "valid"]].reset_index(drop=True)
    demos[["z_x", "z_y"]] = fits.z_theta
    demos["residual_m"] = fits.residual_m / frame.scale
    errors = held_out_errors(np.stack([spread(points[a:b]) for a, b in pairwise(offsets)]))
    demos["degree"] = picked_degrees(errors)
    demos["needs_more"] = (demos["degree"] > DEGREES[0]) & fits.poor
    for degree, error in zip(DEGREES, errors, strict=True):
        demos[f"held_out_{degree}"] = np.sqrt(error.mean(0)) / frame.scale
    return demos


def spread(points: Float[Array, "sample 2"]) -> Float[Array, "40 2"]:
    """Return POINTS points along a polyline, equally far apart."""
    passed = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    at = np.linspace(0.0, passed[-1], POINTS)
    return np.stack([np.interp(at, passed, points[:, i]) for i in (0, 1)], -1)


def held_out_errors(points: Float[Array, "demo 40 2"]) -> Float[Array, "degree fold demo"]:
    """Return each demonstration's mean square distance [m^2] of held-out points from the curve fitted to the others."""
    fold = np.arange(POINTS) * 2 * FOLDS // POINTS % FOLDS
    return np.array([[_error(points, fold == k, degree) for k in range(FOLDS)] for degree in DEGREES])


def _error(points: Array, held_out: Array, degree: int) -> Float[Array, " demo"]:
    """Return the error of curves of one degree, fitted by minimising distances along the curves' normals.

    Each round linearises the distances at the nearest points (tangent distance minimisation; Blake and Isard, 1998).
    """
    kept, tested = points[:, ~held_out], points[:, held_out]
    polygon = np.zeros((len(points), degree + 1, 2))  # control points
    polygon[:, 0], polygon[:, -1] = P_INIT, P_F
    u = np.broadcast_to(np.linspace(0.0, 1.0, POINTS)[~held_out], kept.shape[:2])
    inner = _basis(u, degree)[..., 1:-1]
    rest = kept - _at(u, polygon)
    polygon[:, 1:-1] = np.linalg.solve(inner.mT @ inner + DAMPING * np.eye(degree - 1), inner.mT @ rest)
    for _ in range(ROUNDS):
        u = _nearest(kept, polygon)
        along = _speed(u, polygon)
        normal = np.stack([-along[..., 1], along[..., 0]], -1) / np.linalg.norm(along, axis=-1, keepdims=True)
        inner = _basis(u, degree)[..., 1:-1]
        rows = (inner[..., None] * normal[:, :, None]).reshape(*inner.shape[:2], -1)  # (demo, point, coordinate)
        apart = ((kept - _at(u, polygon)) * normal).sum(-1, keepdims=True)
        matrix = rows.mT @ rows + DAMPING * np.eye(rows.shape[-1])
        polygon[:, 1:-1] += np.linalg.solve(matrix, rows.mT @ apart).reshape(-1, degree - 1, 2)
    return ((tested - _at(_nearest(tested, polygon), polygon)) ** 2).sum(-1).mean(-1)


def _nearest(points: Float[Array, "demo point 2"], polygon: Float[Array, "demo k 2"]) -> Float[Array, "demo point"]:
    """Return the parameter of each point's nearest place on its curve: the best of a grid, then Newton's steps."""
    grid = np.broadcast_to(np.linspace(0.0, 1.0, CURVE_POINTS), (len(points), CURVE_POINTS))
    curves = _at(grid, polygon)
    u = grid[0][((points[:, :, None] - curves[:, None]) ** 2).sum(-1).argmin(-1)]
    for _ in range(2):
        along = _speed(u, polygon)
        step = ((points - _at(u, polygon)) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
        u = np.clip(u + np.clip(step, -1 / CURVE_POINTS, 1 / CURVE_POINTS), 0.0, 1.0)
    return u


def _at(u: Float[Array, "demo point"], polygon: Float[Array, "demo k 2"]) -> Float[Array, "demo point 2"]:
    """Return points [m] on curves with these control points."""
    return _basis(u, polygon.shape[1] - 1) @ polygon


def _speed(u: Float[Array, "demo point"], polygon: Float[Array, "demo k 2"]) -> Float[Array, "demo point 2"]:
    """Return the curves' derivatives by the parameter."""
    degree = polygon.shape[1] - 1
    return _basis(u, degree - 1) @ (degree * np.diff(polygon, axis=1)) + 1e-9


def _basis(u: Float[Array, "*u"], degree: int) -> Float[Array, "*u control_point"]:
    """Return the Bernstein polynomials."""
    return np.stack([comb(degree, k) * u**k * (1 - u) ** (degree - k) for k in range(degree + 1)], -1)


def picked_degrees(errors: Float[Array, "degree fold demo"]) -> Array:
    """Return the smallest degree whose error is within one standard error of the least (Breiman et al., 1984)."""
    mean = errors.mean(1)  # (degree, demo)
    best = mean.argmin(0)
    error = errors.std(1, ddof=1) / np.sqrt(errors.shape[1])
    limit = np.take_along_axis(mean + error, best[None], 0)
    return np.array(DEGREES)[(mean <= limit).argmax(0)]
