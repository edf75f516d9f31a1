"""Association is what counting says, with an interval over scenes, and is no effect."""

import numpy as np
import pytest
import statsmodels.api as sm

from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, random_layouts
from pipeline.world.rules import valid
from studies.confounding.association import association, passes_near
from tests.factories import ITEMS, RULES


def rng() -> np.random.Generator:
    return np.random.default_rng(11)


@pytest.mark.parametrize("symbol", SYMBOLS)
def test_a_path_passes_near_a_symbol_if_a_user_with_that_margin_finds_it_invalid(symbol: str):
    layouts = random_layouts(rng(), 10, ITEMS, np.arange(4), RULES)
    z_theta = random_z_theta(rng(), 10, 30)
    margins = dict.fromkeys(SYMBOLS) | {symbol: 0.045}
    near = passes_near(layouts, z_theta, SYMBOLS.index(symbol), 0.045)
    np.testing.assert_array_equal(near, ~valid(layouts, z_theta, margins))


def test_the_difference_is_the_one_counted_by_hand_and_undefined_if_all_paths_or_none_pass_near():
    invalid = np.array([[1, 1, 0, 0], [1, 0, 0, 0]], dtype=bool)
    near = np.array([[1, 1, 1, 0], [0, 0, 1, 0]], dtype=bool)
    row = association(invalid, near)
    assert (row.p_invalid_near, row.p_invalid_far, row.difference) == (0.5, 0.25, 0.25)
    assert (row.demonstrations, row.near) == (8, 4)
    assert all(np.isnan(association(invalid, np.full((2, 4), everywhere)).difference) for everywhere in (False, True))


def test_the_interval_is_that_of_least_squares_with_errors_clustered_by_scene():
    scene, path = rng().normal(size=(200, 1)), rng().normal(size=(200, 9))
    near = rng().normal(size=(200, 9)) + scene > 0.5
    invalid = path + scene + near > 1
    row = association(invalid, near)
    fit = sm.OLS(invalid.ravel().astype(float), sm.add_constant(near.ravel().astype(float))).fit()
    robust = fit.get_robustcov_results("cluster", groups=np.repeat(np.arange(200), 9))
    assert row.difference == pytest.approx(fit.params[1], abs=1e-6)
    np.testing.assert_allclose([row.ci_low, row.ci_high], robust.conf_int()[1], atol=0.003)


def test_a_common_cause_associates_what_has_no_effect():
    """Glass g makes a path invalid; plate p only comes with it: adjusted for g, p says nothing."""
    g, alone, bound, bad = rng().uniform(size=(4, 400, 9)) < np.array([0.4, 0.4, 0.9, 0.8])[:, None, None]
    p, invalid = np.where(bound, g, alone), g & bad
    assert association(invalid, p).ci_low > 0.5
    adjusted = association(invalid[g].reshape(-1, 1), p[g].reshape(-1, 1))
    assert adjusted.ci_low < 0 < adjusted.ci_high
