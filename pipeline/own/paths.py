"""Fit a Bezier path to each demonstration, and ask by cross-validation whether one control point is enough.

The models take paths of degree 2. A demonstration needs more if cross-validation over its samples picks a higher degree
and a parabola misses the hand by more than a pixel of the model's image.
"""

from math import comb

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.models.base import Z_RANGE_M
from pipeline.own.csv_files import Faults
from pipeline.own.folder import DEMONSTRATIONS, KEY, Folder
from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.bezier_fit import fit
from pipeline.world.layout import SIDE

DEGREES = (2, 3, 4, 5)
POINTS = 40  # points of a demonstration, equally far apart, that cross-validation uses
FOLDS = 5  # each holds two stretches of the path
CURVE_POINTS = 101  # points of a curve among which the nearest is searched
ROUNDS = 4  # of assigning points to places on the curve
POOR_ABOVE_M = 1 / SIDE  # a pixel of the model's image [m]


def fit_demonstrations(folder: Folder, faults: Faults) -> pd.DataFrame:
    """Return one row for each demonstration, sorted by scene, user and demo.

    Columns: scene, user, demo, valid, z_x, z_y (control point in the model's metres), residual_m (root mean square
    distance from the path, metres on the table), degree (picked by cross-validation), needs_more, and held_out_2 to
    held_out_5 (residuals [m] on held-out stretches, by degree). Adds a fault for control points out of the models' range.
    """
    samples = folder.samples
    start = np.flatnonzero((samples[KEY] != samples[KEY].shift()).any(axis=1).to_numpy())
    offsets = np.append(start, len(samples))
    points = folder.frame.to_model(samples[["x", "y"]].to_numpy())
    fits = fit(points, offsets, poor_above_m=POOR_ABOVE_M)
    scale = folder.frame.scale
    demos = samples.loc[start, [*KEY, "valid", "row"]].reset_index(drop=True)
    demos[["z_x", "z_y"]] = fits.z_theta
    demos["residual_m"] = fits.residual_m / scale
    far = ((fits.z_theta < Z_RANGE_M[0]) | (fits.z_theta > Z_RANGE_M[1])).any(axis=1)
    names = [", ".join(key) for key in demos[KEY].itertuples(index=False)]
    faults.rows(
        DEMONSTRATIONS,
        far,
        lambda i: f"demonstration ({names[i]}) swings out farther than the models' paths can: leave it out",
        demos["row"].to_numpy(),
    )
    errors = held_out_errors(np.stack([spread(points[a:b]) for a, b in zip(start, offsets[1:], strict=True)]))
    demos["degree"] = picked_degrees(errors)
    demos["needs_more"] = (demos["degree"] > DEGREES[0]) & fits.poor
    for degree, error in zip(DEGREES, errors, strict=True):
        demos[f"held_out_{degree}"] = np.sqrt(error.mean(0)) / scale
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
    kept, grid = points[:, ~held_out], np.linspace(0.0, 1.0, CURVE_POINTS)
    u = np.broadcast_to(np.linspace(0.0, 1.0, POINTS)[~held_out], kept.shape[:2])
    on_curve = _basis(grid, degree)  # (curve point, control point)
    curves = kept
    for _ in range(ROUNDS):
        basis = _basis(u, degree)  # (demo, point, control point)
        inner, rest = basis[..., 1:-1], kept - basis[..., :1] * P_INIT - basis[..., -1:] * P_F
        normal = inner.mT @ inner + 1e-9 * np.eye(degree - 1)
        control = np.linalg.solve(normal, inner.mT @ rest)  # (demo, inner control point, 2)
        curves = on_curve[:, :1] * P_INIT + on_curve[:, -1:] * P_F + on_curve[:, 1:-1] @ control
        u = grid[_square_distances(kept, curves).argmin(-1)]
    return _square_distances(points[:, held_out], curves).min(-1).mean(-1)


def _square_distances(points: Array, curves: Array) -> Float[Array, "demo point curve_point"]:
    return ((points[:, :, None] - curves[:, None]) ** 2).sum(-1)


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
