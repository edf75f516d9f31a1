"""Simulated hands move as hands do, and an unusable trajectory is refused."""

from itertools import pairwise

import numpy as np
import pytest

from pipeline.world.bezier import P_F, P_INIT, curve, random_z_theta
from pipeline.world.hand import ARC_POINTS, Hand, join, simulate, valid_trajectories
from pipeline.world.layout import SYMBOLS, Layouts
from tests.factories import composed

HAND = Hand.of(composed().demos.hand)
UNSTEADY = ("jitter_s", "speed_spread", "tremor_m", "drift_m", "height_drift_m")
STEADY = HAND.model_copy(update=dict.fromkeys(UNSTEADY, 0.0))


def test_simulated_trajectories_keep_to_the_ends_vary_in_length_and_are_sampled_at_about_50_hz():
    rng = np.random.default_rng(3)
    made = [simulate(rng, curve(z, ARC_POINTS), HAND) for z in random_z_theta(rng, 200)]
    assert all((np.diff(r[:, 0]) > 0).all() for r in made)
    assert all(np.abs(r[[0, -1], 1:3] - [P_INIT, P_F]).max() < 0.01 for r in made)
    assert len({len(r) for r in made}) > 50
    steps = np.concatenate([np.diff(r[:, 0]) for r in made])
    assert abs(steps.mean() - 0.02) < 2e-4
    assert 0.002 < steps.std() < 0.004  # two jittered instants a step


def test_a_steady_hand_follows_the_arc_with_minimum_jerk():
    z = np.array([0.1, 0.9])
    t, x, y, _ = simulate(np.random.default_rng(0), curve(z, ARC_POINTS), STEADY).T
    passed = np.concatenate([[0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    tau = t / t[-1]
    np.testing.assert_allclose(passed / passed[-1], 10 * tau**3 - 15 * tau**4 + 6 * tau**5, atol=1e-3)
    assert passed[-1] / t[-1] == pytest.approx(STEADY.speed_m_s, rel=1e-3)
    path = curve(z, 2000)
    gaps = np.linalg.norm(np.stack([x, y], -1)[:, None] - path, axis=-1).min(1)
    assert gaps.max() < 5e-4


@pytest.mark.parametrize("samples", [3, 8, 200])
def test_a_trajectory_keeps_from_a_glass_what_its_straight_pieces_keep(samples: int):
    """However far apart the samples are, and whatever it is judged beside; a dense line is the reference."""
    rng = np.random.default_rng(samples)
    where = np.stack([np.full(3, 0.62), np.full(3, 0.38)], -1)[:, None]
    glass, zero = np.full((3, 1), SYMBOLS.index("glass")), np.zeros((3, 1))
    tables = Layouts(glass, glass, where, zero, zero + 1, zero, zero + 0.05)
    made = []
    for count in (samples, 40, samples):
        x = np.concatenate([[0.05], np.sort(rng.uniform(0.05, 0.95, count - 2)), [0.95]])
        y = np.concatenate([[0.05], rng.uniform(0.05, 0.95, count - 2), [0.95]])
        made.append(np.stack([np.arange(count) / 10, x, y, zero[0].repeat(count)], 1))
    for alone, table in zip(made, range(3), strict=True):
        fine = np.concatenate([np.linspace(a, b, 2000) for a, b in pairwise(alone[:, 1:3])])
        away = np.linalg.norm(fine - where[table, 0], axis=1).min() - 0.05
        for margin, keeps_it in ((away - 1e-3, True), (away + 1e-3, False)):
            margins = {s: margin if s == "glass" else None for s in SYMBOLS}
            together = valid_trajectories(tables, *join(made), margins)[table, 0]
            assert together == valid_trajectories(tables[[table]], *join([alone]), margins)[0, 0] == keeps_it
