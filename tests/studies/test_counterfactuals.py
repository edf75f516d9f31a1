"""The study moves an item exactly as far as the path asks, and scores the moves that a model asks for."""

import numpy as np
import pytest

from pipeline.world.layout import SYMBOLS, empty
from pipeline.world.rules import clearance, slack
from studies.counterfactuals.stage import crossing, outward_normal, score_moves, translate_item


def test_a_glass_moves_off_a_straight_path_by_what_the_margin_lacks():
    layouts, slot, z = empty(1, 2), np.array([0]), np.array([[0.5, 0.5]])
    layouts.symbol[0, 0], layouts.item[0, 0], layouts.radius[0, 0] = SYMBOLS.index("glass"), 3, 0.04
    layouts.centre[0, 0] = 0.5, 0.52
    direction = outward_normal(layouts, slot, z)
    np.testing.assert_allclose(direction, [[-(0.5**0.5), 0.5**0.5]])  # the path runs up the diagonal
    steps = np.linspace(0, 0.12, 121)
    moved = translate_item(layouts, slot, direction, steps)
    margins = {symbol: 0.045 if symbol == "glass" else None for symbol in SYMBOLS}
    room = slack(moved, clearance(moved, np.repeat(z, 121, axis=0)[:, None]), margins)
    expected = 0.04 + 0.045 - 0.02 * 0.5**0.5
    assert crossing(steps, room.T, 0.0) == pytest.approx(expected, abs=0.0005)
    np.testing.assert_array_equal(layouts.centre[0, 0], [0.5, 0.52])  # the scene itself stays as it was


def test_a_crossing_is_the_first_one_linear_between_steps():
    values = np.array([[0.1, 0.3, 0.7], [0.6, 0.1, 0.1], [0.1, 0.2, 0.5], [0.0, 1.0, 0.0]])
    np.testing.assert_allclose(crossing(np.arange(3.0), values, 0.5), [1.5, 0.0, np.nan, 0.5])


def test_moves_are_scored_where_a_model_rejects_first_and_accepts_later():
    true_m = np.array([0.02, 0.04, 0.06])
    moved_m = np.array([[0.03, np.nan, 0.05], [0.02, 0.04, 0.06]])
    row = score_moves(moved_m, np.array([[True, True, True], [True, True, False]]), true_m)
    assert (row["cases"], row["true_m"], row["found"]) == pytest.approx((3, 0.04, 0.8))
    assert (row["rejected"], row["error_m"]) == pytest.approx((5 / 6, 0.005))
    assert row["constant_error_m"] == pytest.approx((0.02 + 0.02 + 0.02 + 0) / 4)
    assert np.isnan(row["error_m_ci_low"]) and np.isnan(row["found_ci_high"]), "too few for an interval"
    many = score_moves(np.tile(moved_m, (2, 4)), np.ones((4, 12), bool), np.tile(true_m, 4))
    assert many["error_m_ci_low"] < many["error_m"] < many["error_m_ci_high"]
    assert score_moves(moved_m, np.zeros((2, 3), bool), true_m) == {"cases": 3, "rejected": 0, "true_m": true_m.mean()}
