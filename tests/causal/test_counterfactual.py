"""Attribution is what the rules of the world say, and models that know the truth are never wrong."""

import numpy as np
import pytest

from pipeline.causal.counterfactual import (
    NO_SINGLE_CAUSE,
    Removals,
    Subsets,
    attribute,
    baselines,
    item_subsets,
    score_attributions,
    select_items,
)
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts, random_layouts
from pipeline.world.rules import clearance, valid
from tests.factories import ITEMS, RULES

CAREFUL: dict[str, float | None] = {symbol: 0.045 for symbol in SYMBOLS}
NORMAL: dict[str, float | None] = {symbol: 0.045 if symbol == "glass" else None for symbol in SYMBOLS}
SCENES, PATHS = 20, 40


@pytest.fixture(scope="module")
def layouts() -> Layouts:
    return random_layouts(np.random.default_rng(0), SCENES, ITEMS, np.arange(4), RULES)


@pytest.fixture(scope="module")
def z_theta() -> np.ndarray:
    return random_z_theta(np.random.default_rng(1), SCENES, PATHS)


@pytest.fixture(scope="module")
def subsets(layouts: Layouts) -> Subsets:
    return item_subsets(layouts.present)


def true_removals(layouts: Layouts, z_theta: np.ndarray, subsets: Subsets, margins: dict) -> Removals:
    left = select_items(layouts[subsets.scene], subsets.kept)
    return subsets.by_question(valid(left, z_theta[subsets.scene], margins).astype(float))


def of_seeds(answer: Removals, seeds: int) -> Removals:
    parts = (answer.factual, answer.empty, answer.without, answer.alone)
    return Removals(*(np.repeat(part[None], seeds, axis=0) for part in parts))


@pytest.mark.parametrize("margins", [CAREFUL, NORMAL])
def test_an_item_too_near_is_sufficient_and_the_only_one_is_necessary(
    layouts: Layouts, z_theta: np.ndarray, subsets: Subsets, margins: dict
):
    truth = true_removals(layouts, z_theta, subsets, margins)
    margin = np.array([np.nan if margins[s] is None else margins[s] for s in SYMBOLS] + [np.nan])
    near = layouts.present[:, None] & (clearance(layouts, z_theta) <= margin[layouts.symbol][:, None])
    invalid, single = near.any(-1), near.sum(-1) == 1
    np.testing.assert_array_equal(truth.factual == 0, invalid)
    np.testing.assert_array_equal(truth.sufficiency, near.astype(float))
    np.testing.assert_array_equal(truth.necessity[invalid], (near & single[..., None])[invalid].astype(float))
    np.testing.assert_array_equal(attribute(truth.necessity), np.where(single, near.argmax(-1), NO_SINGLE_CAUSE))
    assert single.any() and (~single & invalid).any()


@pytest.mark.parametrize("margins", [CAREFUL, NORMAL])
def test_models_that_know_the_truth_are_never_wrong(
    layouts: Layouts, z_theta: np.ndarray, subsets: Subsets, margins: dict
):
    truth = true_removals(layouts, z_theta, subsets, margins)
    chances = baselines(attribute(truth.necessity), layouts.present, clearance(layouts, z_theta))
    row = score_attributions(of_seeds(truth, 3), truth, chances)
    for name in ("right", "ci_low", "ci_high", "overdetermined_right", "recall"):
        assert row[name] == 1, name
    assert row["rejected"] == (truth.factual == 0).sum() and row["empty_rejected"] == 0
    assert 1 / 3 <= row["baseline_random_item"] < row["baseline_nearest_item"] <= 1
