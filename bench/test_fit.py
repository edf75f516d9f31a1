"""Compare fitting all trajectories at once with one `scipy.optimize.least_squares` call per trajectory.

scipy fits z_theta and every sample's parameter with the exact Jacobian, the usual formulation. Both run on one thread
in the same session, and the ratio counts at equal residual.
"""

import time

import numpy as np
import pytest
from scipy.optimize import least_squares

from pipeline.world.bezier import P_F, P_INIT, basis, curve, random_z_theta
from pipeline.world.bezier_fit import fit
from pipeline.world.hand import ARC_POINTS, Hand, join, simulate

HAND = Hand(
    rate_hz=50.0,
    jitter_s=0.002,
    speed_m_s=0.35,
    speed_spread=0.2,
    tremor_m=0.0007,
    tremor_hz=[8.0, 12.0],
    drift_m=0.002,
    height_m=0.1,
    height_drift_m=0.01,
)  # conf/demos.yaml
MANY, FEW = 1000, 10  # recordings fitted at once, and one at a time
CONTROL = np.stack([P_INIT, np.zeros(2), P_F])


def by_scipy(x: np.ndarray) -> float:
    """Return the root mean square distance at the optimum over z and every sample's parameter."""
    steps, n = np.hypot(*np.diff(x, axis=0).T), len(x)
    u = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()  # start: by recorded length, with the closed-form z
    b1 = basis(u)[:, 1:2]
    z = (b1 * (x - basis(u) @ CONTROL)).sum(0) / (b1 * b1).sum()

    def residual(p: np.ndarray) -> np.ndarray:
        return (basis(p[2:]) @ np.stack([P_INIT, p[:2], P_F]) - x).ravel()

    def jacobian(p: np.ndarray) -> np.ndarray:
        z, u = p[:2], p[2:, None]
        out = np.zeros((n, 2, n + 2))
        out[:, 0, 0] = out[:, 1, 1] = basis(p[2:])[:, 1]
        out[np.arange(n), :, 2 + np.arange(n)] = 2 * (1 - u) * (z - P_INIT) + 2 * u * (P_F - z)
        return out.reshape(2 * n, n + 2)

    low, high = np.concatenate([[-np.inf] * 2, np.zeros(n)]), np.concatenate([[np.inf] * 2, np.ones(n)])
    begin = np.concatenate([z, np.clip(u, 1e-9, 1 - 1e-9)])
    optimum = least_squares(residual, begin, jacobian, (low, high), x_scale="jac")  # pyright: ignore[reportArgumentType]
    return float(np.sqrt(2 * optimum.cost / n))


@pytest.mark.benchmark(group=f"fit of {MANY} recordings")
def test_all_at_once_is_a_hundred_times_faster_at_equal_residual(benchmark):
    rng = np.random.default_rng(0)
    samples, offsets = join([simulate(rng, curve(z, ARC_POINTS), HAND) for z in random_z_theta(rng, MANY)])
    points = samples[:, 1:3]
    fits = benchmark.pedantic(fit, (points, offsets, 0.004), rounds=3, warmup_rounds=1)
    begin = time.perf_counter()
    residual = np.array([by_scipy(points[offsets[i] : offsets[i + 1]]) for i in range(FEW)])
    ratio = round((time.perf_counter() - begin) / FEW / (benchmark.stats.stats.min / MANY), 1)
    benchmark.extra_info["results"] = {"fit_speedup_scipy": ratio}
    excess = fits.residual_m[:FEW] / residual - 1
    assert np.median(excess) < 1e-3 and excess.max() < 0.01, f"residuals exceed scipy's by {excess}"
    assert ratio > 100, f"{ratio} times one scipy call per recording: the aim is 100"
