"""The test of the procedure measures what it says: regimes are recovered, and what is certain comes out as such."""

import numpy as np
import pytest

from pipeline.causal.selftest import Regime, check, observed, resampled, stylised
from pipeline.causal.statistics import VERDICTS

REGIME = Regime(0.03, 0.1, 0.05)
EFFECTS = [0.02, 0.1, 0.6]


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.fixture(scope="module")
def found() -> dict:
    return check(rng(), stylised(REGIME, 12, 10, 40), families=60, cells=12, effects=EFFECTS)


@pytest.mark.parametrize("skewed", [False, True])
def test_a_regime_is_recovered_from_effects_drawn_by_it(skewed: bool):
    regime = Regime(0.03, 0.1, 0.05, skewed)
    found = observed(stylised(regime, 400, 10, 100)(rng(), 1)[0])
    np.testing.assert_allclose([found.by_seed, found.by_scene, found.rest], [0.03, 0.1, 0.05], rtol=0.05)


def test_chance_that_lies_in_a_few_scenes_has_the_same_spread():
    regime = Regime(0.0, 0.06, 0.0, seldom=0.04)
    (effects,) = stylised(regime, 4000, 1, 100)(rng(), 1)
    assert len(np.unique(effects)) == 2
    assert effects.std() == pytest.approx(0.06, rel=0.02)
    assert effects.mean() == pytest.approx(0, abs=0.001)
    assert (effects < 0).mean() == pytest.approx(0.04, abs=0.002)


def test_where_nothing_varies_the_regime_is_nothing():
    assert observed(np.zeros((3, 4, 5))) == Regime(0.0, 0.0, 0.0)


def test_what_is_drawn_anew_is_made_of_measured_seeds_and_scenes_and_has_no_effect():
    seed_chance, scene_chance = np.array([-0.1, 0.0, 0.4]), np.array([0.0, 0.0, 0.0, 0.8])
    effects = 0.5 + (seed_chance[:, None] + scene_chance)[None] * np.array([1.0, 2.0])[:, None, None]
    families = resampled(effects)(rng(), 4000)
    assert families.shape == (4000, 2, 3, 4)
    np.testing.assert_allclose(families[:, 1], 2 * families[:, 0], atol=1e-12)  # one draw for all cells of a family
    assert set(families[:, 0].round(9).ravel()) == set((effects[0] - effects[0].mean()).round(9).ravel())
    np.testing.assert_allclose(families.mean((0, 2, 3)), 0, atol=0.02)


def test_cells_that_no_family_draws_still_count_against_the_others():
    draw = stylised(REGIME, 2, 10, 40)
    few, many = (check(rng(), draw, families=300, cells=cells, effects=[]) for cells in (2, 40))
    assert many["family_wise_error"] < few["family_wise_error"]
    assert many["coverage"] == few["coverage"]


def test_the_effect_stands_in_every_cell_in_turn():
    certain = np.zeros((3, 4, 200))
    certain[2] = np.random.default_rng(0).normal(0, 5, 200)  # an effect here is lost in chance
    found = check(rng(), resampled(certain), families=60, cells=3, effects=[0.3])
    assert found["power"]["0.3"]["effect"] == pytest.approx(2 / 3, abs=0.05)


def test_verdicts_share_out_all_families(found: dict):
    for said in found["power"].values():
        assert set(said) == set(VERDICTS)
        assert sum(said.values()) == pytest.approx(1)


def test_power_grows_with_the_effect_and_a_huge_one_is_never_missed(found: dict):
    power = [found["power"][str(effect)]["effect"] for effect in EFFECTS]
    assert power == sorted(power)
    assert power[-1] == 1


def test_without_any_chance_every_effect_of_interest_is_found_and_no_other():
    sure = check(rng(), stylised(Regime(0.0, 0.0, 1e-9), 3, 4, 6), families=5, cells=3, effects=[0.02, 0.08])
    assert sure["power"]["0.02"]["no effect"] == sure["power"]["0.08"]["effect"] == 1
    assert sure["false_causes"] == 0


def test_a_verdict_needs_more_than_a_rejection(found: dict):
    assert found["false_causes"] <= found["family_wise_error"]
    assert 0.9 < found["coverage"] < 1
