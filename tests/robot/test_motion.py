"""Movements start and end at rest, follow their path, and have minimum jerk along it."""

import numpy as np
import pytest

from pipeline.robot.motion import lengths, minimum_jerk
from pipeline.world.bezier import P_F, P_INIT, curve, random_z_theta


def test_a_movement_has_the_speed_profile_of_minimum_jerk():
    straight = (P_INIT + P_F)[None] / 2
    passed = np.linalg.norm(minimum_jerk(straight, 101)[0] - P_INIT, axis=-1) / lengths(straight)
    tau = np.linspace(0, 1, 101)
    np.testing.assert_allclose(passed, 10 * tau**3 - 15 * tau**4 + 6 * tau**5, atol=1e-6)
    speed = np.gradient(passed, tau)
    assert speed.max() == pytest.approx(1.875, rel=1e-3)


def test_a_movement_stays_on_its_path():
    z_theta = random_z_theta(np.random.default_rng(0), 5)
    for points, path in zip(minimum_jerk(z_theta, 40), curve(z_theta, 4001), strict=True):
        away = np.linalg.norm(points[:, None] - path, axis=-1).min(1)
        assert away.max() < 1e-3
        np.testing.assert_allclose(points[[0, -1]], [P_INIT, P_F], atol=1e-12)
