"""Association says what counting says, and is no effect; what a cause adds to effects is told from its control."""

import numpy as np
import pytest
import statsmodels.api as sm

from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import Items, random_layouts
from pipeline.world.rules import valid
from studies.confounding.association import association, before_and_after, passes_near, shift
from tests.examples import RULES

ITEMS = Items(np.arange(4), np.array([0.0, 0.0, 0.075, 0.0]), np.array([0.065, 0.075, 0.013, 0.045]))


def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def test_who_comes_within_a_users_margin_of_the_symbol_it_minds_is_invalid():
    layouts = random_layouts(rng(), 10, ITEMS, np.arange(4), RULES)
    z = random_z_theta(rng(), 10, 30)
    for symbol, name in enumerate(("bowl", "plate", "cutlery", "glass")):
        minds = dict.fromkeys(("bowl", "plate", "cutlery", "glass")) | {name: 0.045}
        np.testing.assert_array_equal(passes_near(layouts, z, symbol, 0.045), ~valid(layouts, z, minds))


def test_the_difference_is_the_one_counted_by_hand():
    invalid = np.array([[1, 1, 0, 0], [1, 0, 0, 0]], dtype=bool)
    near = np.array([[1, 1, 1, 0], [0, 0, 1, 0]], dtype=bool)
    found = association(invalid, near)
    assert (found["p_invalid_near"], found["p_invalid_far"]) == (0.5, 0.25)
    assert (found["difference"], found["n_demos"], found["near"]) == (0.25, 8, 4)


def test_who_is_never_or_always_near_says_nothing():
    invalid = rng().uniform(size=(5, 4)) < 0.5
    for near in (np.zeros((5, 4), bool), np.ones((5, 4), bool)):
        assert association(invalid, near)["difference"] is None


def test_the_interval_is_that_of_least_squares_with_errors_clustered_by_scene():
    scene, path = rng().normal(size=(200, 1)), rng().normal(size=(200, 9))
    near = rng().normal(size=(200, 9)) + scene > 0.5
    invalid = path + scene + near > 1
    found = association(invalid, near)
    groups = np.repeat(np.arange(200), 9)
    fit = sm.OLS(invalid.ravel().astype(float), sm.add_constant(near.ravel().astype(float))).fit()
    robust = fit.get_robustcov_results("cluster", groups=groups)
    assert found["difference"] == pytest.approx(fit.params[1], abs=1e-6)
    np.testing.assert_allclose([found["ci_low"], found["ci_high"]], robust.conf_int()[1], atol=0.003)


def test_the_interval_holds_the_truth_as_often_as_it_promises():
    generator, held = rng(), []
    for _ in range(400):
        scene = generator.normal(size=(40, 1))
        near = generator.normal(size=(40, 9)) > 0.5
        invalid = generator.normal(size=(40, 9)) + scene > 1
        found = association(invalid, near)
        held.append(found["ci_low"] <= 0 <= found["ci_high"])
    assert 0.92 < np.mean(held) < 0.98


def test_a_common_cause_associates_what_has_no_effect():
    """Glass g makes a path invalid; plate p only comes with it: adjusted for g, p says nothing."""
    g, alone, bound, bad = rng().uniform(size=(4, 400, 9)) < np.array([0.4, 0.4, 0.9, 0.8])[:, None, None]
    p, invalid = np.where(bound, g, alone), g & bad
    assert association(invalid, p)["ci_low"] > 0.5
    found = association(invalid[g].reshape(-1, 1), p[g].reshape(-1, 1))
    assert found["ci_low"] < 0 < found["ci_high"]


def test_what_is_added_to_a_control_is_found_and_nothing_where_nothing_is():
    control = rng().normal(0, 0.02, (3, 10, 50))
    added = np.array([0.0, -0.1, 0.3])
    found = shift(control + added[:, None, None], control)
    np.testing.assert_allclose([cell["difference"] for cell in found], added, atol=1e-6)
    noisy = shift(control, rng().permutation(control.ravel()).reshape(control.shape))
    assert all(cell["ci_low"] < 0 < cell["ci_high"] for cell in noisy)


def test_before_is_the_ordinary_table_and_after_the_one_with_the_symbol():
    p = rng().uniform(size=(2, 3, 4, 5, 6))  # user, seed, table, scene, path
    before, after = before_and_after(p, 3, [0, 2])
    assert before.shape == after.shape == (4, 3, 5)
    np.testing.assert_allclose(before[1], p[0, :, 3].mean(-1))
    np.testing.assert_allclose(after[3], p[1, :, 2].mean(-1))
    np.testing.assert_allclose(before_and_after(p[:, 0], 3, [0, 2])[1], after[:, 0])  # the truth has no seeds
