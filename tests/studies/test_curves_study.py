"""Study curves: an S-shape is no parabola, a hand's S-shape is fitted closely, and the oracle's repair is the least."""

import numpy as np

from pipeline.planning import bumps
from pipeline.world.bezier import bezier, curve, random_z_theta
from pipeline.world.bezier_fit import fit_any
from pipeline.world.hand import ARC_POINTS, simulate
from pipeline.world.layout import empty
from pipeline.world.rules import line_clearance
from studies.curves.stage import forced, s_shapes
from tests.world.test_hand import HAND

RNG = np.random.default_rng(0)


def test_a_curve_of_degree_4_follows_a_hand_that_a_parabola_misses():
    controls = s_shapes(RNG, 10)
    away, missed = [], []
    for one in controls:
        hand = simulate(RNG, bezier(one, ARC_POINTS), HAND)[:, 1:3]
        fitted, _, residual = fit_any(hand, 4)
        to_fitted = np.linalg.norm(hand[:, None] - bezier(fitted, 20001), axis=-1).min(1)
        np.testing.assert_allclose(residual, np.sqrt((to_fitted**2).mean()), rtol=0.02, atol=1e-4)
        away.append(residual)
        parabola = curve(forced(bezier(one, 161)[None, None])[0, 0], 2001)
        missed.append(np.linalg.norm(hand[:, None] - parabola, axis=-1).min(1).mean())
    assert np.mean(away) < 0.012 and np.mean(missed) > 2 * np.mean(away)


def test_a_parabola_forced_into_parabolas_is_itself():
    z = random_z_theta(RNG, 2, 3)
    np.testing.assert_allclose(curve(forced(curve(z, 161)), 9), curve(z, 9), atol=0.02)


def test_the_search_finds_the_least_displacement_past_a_disc():
    layouts = empty(1, 1)
    layouts.symbol[0, 0], layouts.centre[0, 0], layouts.radius[0, 0] = 0, (0.5, 0.48), 0.1
    line = np.stack([np.linspace(0.1, 0.9, bumps.POINTS), np.full(bumps.POINTS, 0.5)], -1)

    def log_valid(scene, curves):
        return np.where(line_clearance(layouts, curves[None])[0, :, 0] > 0, 0.0, -np.inf)

    offsets, log_p = bumps.nearest(log_valid, 0, line, 1.0)
    ends = line + bumps.basis() @ offsets
    assert log_p == 0 and ends[:, 1].max() > 0.575  # over the nearer side
    np.testing.assert_allclose(ends[[0, -1]], line[[0, -1]])
    bump = np.zeros((4, 2))
    bump[:, 1] = 0.15  # one that passes, too, and is as wide as they come
    assert bumps.displacement(offsets) < bumps.displacement(bump)
