"""The test of the procedure measures what it says: regimes are recovered, and what is certain comes out as such."""

import numpy as np
import pytest

from pipeline.causal.selftest import Regime, check, null_cells, observed
from pipeline.causal.statistics import VERDICTS

REGIME = Regime(0.03, 0.1, 0.05)
EFFECTS = [0.02, 0.1, 0.6]


def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.fixture(scope="module")
def found() -> dict:
    return check(rng(), REGIME, families=60, cells=12, seeds=10, scenes=40, effects=EFFECTS)


@pytest.mark.parametrize("skewed", [False, True])
def test_a_regime_is_recovered_from_effects_drawn_by_it(skewed: bool):
    regime = Regime(0.03, 0.1, 0.05, skewed)
    found = observed(null_cells(rng(), regime, 400, 10, 100))
    np.testing.assert_allclose([found.by_seed, found.by_scene, found.rest], [0.03, 0.1, 0.05], rtol=0.05)


def test_where_nothing_varies_the_regime_is_nothing():
    assert observed(np.zeros((3, 4, 5))) == Regime(0.0, 0.0, 0.0)


def test_verdicts_share_out_all_families(found: dict):
    for said in found["power"].values():
        assert set(said) == set(VERDICTS)
        assert sum(said.values()) == pytest.approx(1)


def test_power_grows_with_the_effect_and_a_huge_one_is_never_missed(found: dict):
    power = [found["power"][str(effect)]["effect"] for effect in EFFECTS]
    assert power == sorted(power)
    assert power[-1] == 1


def test_without_any_chance_every_effect_of_interest_is_found_and_no_other():
    sure = check(rng(), Regime(0.0, 0.0, 1e-9), families=5, cells=3, seeds=4, scenes=6, effects=[0.02, 0.08])
    assert sure["power"]["0.02"]["no effect"] == sure["power"]["0.08"]["effect"] == 1
    assert sure["false_causes"] == 0


def test_a_verdict_needs_more_than_a_rejection(found: dict):
    assert found["false_causes"] <= found["family_wise_error"]
    assert 0.9 < found["coverage"] < 1
