"""Compare fitting all trajectories at once with one `scipy.optimize.least_squares` call per trajectory.

Two baselines:
- over z_theta and every sample's parameter with the exact Jacobian: the usual formulation for scipy;
- over z_theta alone with our foot points inside the residual: the fastest use of scipy that we know.

All run on one thread in the same session; the last test reports and checks the ratios at equal residual.
"""

import time
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import least_squares

from pipeline.world.bezier import P_F, P_INIT, basis, random_z_theta
from pipeline.world.bezier_fit import _Batch, fit
from pipeline.world.hand import Hand, join, simulate

HAND = Hand(50.0, 0.002, 0.35, 0.2, 0.0007, (8.0, 12.0), 0.002, 0.1, 0.01)  # conf/demos.yaml
MANY, FEW = 1000, 10  # recordings fitted at once, and one at a time
CONTROL = np.stack([P_INIT, np.zeros(2), P_F])


def recordings(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    samples, offsets = join([simulate(rng, z, HAND) for z in random_z_theta(rng, count)])
    return samples[:, 1:3], offsets


def start(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the closed-form z, with parameters by recorded length."""
    steps = np.hypot(*np.diff(x, axis=0).T)
    u = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    b1 = basis(u)[:, 1:2]
    return (b1 * (x - basis(u) @ CONTROL)).sum(0) / (b1 * b1).sum(), u


def path_and_slope(z: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    path = basis(u) @ np.stack([P_INIT, z, P_F])
    return path, 2 * (1 - u)[:, None] * (z - P_INIT) + 2 * u[:, None] * (P_F - z)


def jointly(x: np.ndarray) -> float:
    """Return the root mean square distance at the optimum over z and every sample's parameter."""
    z, u = start(x)
    n = len(x)

    def residual(p: np.ndarray) -> np.ndarray:
        return (path_and_slope(p[:2], p[2:])[0] - x).ravel()

    def jacobian(p: np.ndarray) -> np.ndarray:
        out = np.zeros((n, 2, n + 2))
        out[:, 0, 0] = out[:, 1, 1] = basis(p[2:])[:, 1]
        out[np.arange(n), :, 2 + np.arange(n)] = path_and_slope(p[:2], p[2:])[1]
        return out.reshape(2 * n, n + 2)

    low, high = np.concatenate([[-np.inf] * 2, np.zeros(n)]), np.concatenate([[np.inf] * 2, np.ones(n)])
    begin = np.concatenate([z, np.clip(u, 1e-9, 1 - 1e-9)])
    optimum = least_squares(residual, begin, jacobian, (low, high), x_scale="jac")  # pyright: ignore[reportArgumentType]
    return float(np.sqrt(2 * optimum.cost / n))


def projected(x: np.ndarray) -> float:
    """Return the root mean square distance at the optimum over z alone, with every sample at its foot point."""
    z, u = start(x)
    ones = np.ones((1, len(x)))
    away = (x - P_INIT)[None]  # (row, sample, 2)
    batch = _Batch(away[..., 0], away[..., 1], ones, (P_F - P_INIT)[None], np.zeros((1, 2)))

    def normal(z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        foot = batch.foot_points((z - P_INIT)[None], u[None], steps=6)[0]
        path, slope = path_and_slope(z, foot)
        across = slope[:, ::-1] * [-1, 1] / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9)
        return x - path, across, basis(foot)[:, 1]

    def residual(z: np.ndarray) -> np.ndarray:
        away, across, _ = normal(z)
        return np.concatenate([(away * across).sum(1), (away * across[:, ::-1] * [1, -1]).sum(1)])

    def jacobian(z: np.ndarray) -> np.ndarray:
        _, across, weight = normal(z)
        return np.concatenate([-weight[:, None] * across, np.zeros((len(x), 2))])

    optimum = least_squares(residual, z, jacobian, method="lm")
    return float(np.sqrt(2 * optimum.cost / len(x)))


BASELINES: dict[str, Callable[[np.ndarray], float]] = {"jointly": jointly, "projected": projected}


@pytest.mark.benchmark(group=f"fit of {MANY} recordings")
def test_fit_all_at_once(benchmark):
    points, offsets = recordings(MANY)
    benchmark.pedantic(fit, (points, offsets, 0.004), rounds=3, warmup_rounds=1)


@pytest.mark.benchmark(group=f"fit of {FEW} recordings, one scipy call each")
@pytest.mark.parametrize("baseline", BASELINES)
def test_fit_one_at_a_time(benchmark, baseline):
    points, offsets = recordings(FEW)
    way = BASELINES[baseline]
    benchmark.pedantic(lambda: [way(points[offsets[i] : offsets[i + 1]]) for i in range(FEW)], rounds=2)


@pytest.mark.benchmark(group="fit: the ratio")
def test_all_at_once_is_a_hundred_times_faster_at_equal_residual(benchmark):
    points, offsets = recordings(MANY)
    fits = benchmark.pedantic(fit, (points, offsets, 0.004), rounds=3, warmup_rounds=1)
    ours = benchmark.stats.stats.min / MANY
    for name, way in BASELINES.items():
        begin = time.perf_counter()
        residual = np.array([way(points[offsets[i] : offsets[i + 1]]) for i in range(FEW)])
        theirs = (time.perf_counter() - begin) / FEW
        benchmark.extra_info[f"times_faster_than_{name}"] = round(theirs / ours, 1)
        excess = fits.residual_m[:FEW] / residual - 1
        assert np.median(excess) < 1e-3 and excess.max() < 0.01, f"{name}: residuals exceed scipy's by {excess}"
    ratio = benchmark.extra_info["times_faster_than_jointly"]
    benchmark.extra_info["results"] = {"fit_speedup_scipy": ratio}
    assert ratio > 100, f"{ratio} times one scipy call per recording: the aim is 100"
