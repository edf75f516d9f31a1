"""Read and check demonstrations.csv, and fit a Bezier path to each demonstration.

The models take paths of degree 2. A demonstration needs more if cross-validation over its samples picks a higher degree
and a parabola misses the hand by more than a pixel of the model's image.
"""

from collections.abc import Collection
from itertools import pairwise
from math import comb
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.models.base import Z_RANGE_M
from pipeline.own.csv_files import DEMONSTRATIONS, KEY, Faults, read_checked
from pipeline.own.frame import Frame
from pipeline.own.settings import ENDS_WITHIN_M, MIN_SAMPLES, MIN_SCENES, SETTINGS, Settings
from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.bezier_fit import fit
from pipeline.world.hand import MAX_BEYOND_M
from pipeline.world.layout import SIDE

DEGREES = (2, 3, 4, 5)
POINTS = 40  # points of a demonstration, equally far apart, that cross-validation uses
FOLDS = 5  # each holds two stretches of the path
CURVE_POINTS = 65  # points of a curve among which the nearest is searched
ROUNDS = 8  # of assigning points to places on the curve
DAMPING = 1e-4  # added to the normal equations' diagonal: what the points leave open stays as it is
POOR_ABOVE_M = 1 / SIDE  # a pixel of the model's image [m]


def read_samples(path: Path, scenes: Collection[str], settings: Settings, faults: Faults) -> pd.DataFrame | None:
    """Return the samples of all demonstrations, sorted by demonstration and in their own order; None after a fault.

    Columns: scene, user, demo, t [s], x, y [m on the table], valid, and `name` with scene, user and demo; rows are
    numbered as in the file.
    """
    file, before = DEMONSTRATIONS, len(faults)
    if not (path / file).is_file():
        faults.append(f"{file} is missing: draw paths with `python -m pipeline.own record {path}`, or write it")
        return None
    samples = read_checked(path / file, scenes, faults)
    if samples is not None and samples.empty:
        faults.append(f"{file} has no row below its header: expected demonstrations")
    if samples is None or len(faults) > before:
        return None
    valid, name = samples["valid"].str.lower() == "true", samples["scene"].str.cat(samples[KEY[1:]], sep=", ")
    samples = samples.assign(valid=valid, name=name).sort_values(KEY, kind="stable")
    _check_demonstrations(samples, settings, faults)
    _check_users(samples.drop_duplicates(KEY), faults)
    return samples if len(faults) == before else None


def _check_demonstrations(samples: pd.DataFrame, settings: Settings, faults: Faults) -> None:
    """Add faults of whole demonstrations: labels, times, length, ends."""

    def check(rows: pd.DataFrame, wrong: pd.Series, sentence: str) -> None:
        faults.rows(DEMONSTRATIONS, rows[wrong], sentence)

    groups = samples.groupby(KEY, sort=False)
    samples = samples.assign(earlier=groups["t"].shift())
    first, last, side = groups.head(1), groups.tail(1), settings.side_m
    check(
        samples,
        samples["valid"] != groups["valid"].transform("first"),
        "valid changes within demonstration ({name}): expected one word for all of it",
    )
    check(
        samples,
        samples["t"] < samples["earlier"],
        "t goes back from {earlier:g} to {t:g} s in demonstration ({name}): expected times that increase, and a name "
        "of its own for each demonstration",
    )
    counted = first.assign(rows=groups.size().to_numpy())
    short = counted["rows"] < MIN_SAMPLES
    check(counted, short, f"demonstration ({{name}}) has {{rows}} rows: expected at least {MIN_SAMPLES}")
    for verb, end, rows in (("starts", "start", first), ("ends", "goal", last)):
        x, y = getattr(settings, end)
        rows = rows.assign(away=np.hypot(rows["x"] - x, rows["y"] - y))
        check(
            rows,
            rows["away"] > ENDS_WITHIN_M,
            f"demonstration ({{name}}) {verb} at ({{x:.3g}}, {{y:.3g}}) m, {{away:.2g}} m from the {end} ({x:g}, {y:g})"
            f": expected at most {ENDS_WITHIN_M:g} m; positions are in metres, and {SETTINGS} sets the {end}",
        )
    far = ((samples[["x", "y"]] - side / 2).abs() > (0.5 + MAX_BEYOND_M) * side).any(axis=1)
    check(samples, far, f"the path is at ({{x:g}}, {{y:g}}) m, far off the table: expected metres from 0 to {side:g}")


def _check_users(demos: pd.DataFrame, faults: Faults) -> None:
    """Add a fault for each user with too few scenes or with labels of one kind."""
    for user, rows in demos.groupby("user"):
        where, scenes = f"{DEMONSTRATIONS}, row {rows.index.min()}:", rows["scene"].nunique()
        if scenes < MIN_SCENES:
            faults.append(
                f"{where} user {user} has {scenes} scenes: expected at least {MIN_SCENES}; add demonstrations, or "
                "leave the user out"
            )
        if rows["valid"].nunique() == 1:
            word = "valid" if rows["valid"].iloc[0] else "invalid"
            faults.append(
                f"{where} all {len(rows)} demonstrations of user {user} are {word}: expected both valid and invalid "
                "ones; add the other kind, or leave the user out"
            )


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

    def moved(rows: Array, rest: Array) -> Array:
        return np.linalg.solve(rows.mT @ rows + DAMPING * np.eye(rows.shape[-1]), rows.mT @ rest)

    u = np.broadcast_to(np.linspace(0.0, 1.0, POINTS)[~held_out], kept.shape[:2])
    polygon[:, 1:-1] = moved(_basis(u, degree)[..., 1:-1], kept - _basis(u, degree) @ polygon)
    for _ in range(ROUNDS):
        u = _nearest(kept, polygon)
        along = _speed(u, polygon)
        normal = np.stack([-along[..., 1], along[..., 0]], -1) / np.linalg.norm(along, axis=-1, keepdims=True)
        inner = _basis(u, degree)[..., 1:-1, None]
        rows = (inner * normal[:, :, None]).reshape(*u.shape, -1)  # (demo, point, coordinate)
        apart = ((kept - _basis(u, degree) @ polygon) * normal).sum(-1, keepdims=True)
        polygon[:, 1:-1] += moved(rows, apart).reshape(-1, degree - 1, 2)
    return ((tested - _basis(_nearest(tested, polygon), degree) @ polygon) ** 2).sum(-1).mean(-1)


def _nearest(points: Float[Array, "demo point 2"], polygon: Float[Array, "demo k 2"]) -> Float[Array, "demo point"]:
    """Return the parameter of each point's nearest place on its curve: the best of a grid, then Newton's steps."""
    degree, grid = polygon.shape[1] - 1, np.linspace(0.0, 1.0, CURVE_POINTS)
    curves = _basis(np.broadcast_to(grid, (len(points), CURVE_POINTS)), degree) @ polygon
    u = grid[((points[:, :, None] - curves[:, None]) ** 2).sum(-1).argmin(-1)]
    for _ in range(2):
        along = _speed(u, polygon)
        step = ((points - _basis(u, degree) @ polygon) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-12)
        u = np.clip(u + np.clip(step, -1 / CURVE_POINTS, 1 / CURVE_POINTS), 0.0, 1.0)
    return u


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
