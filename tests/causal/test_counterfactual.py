"""Attribution is what the rules of the world say, and models that know the truth are never wrong."""

import numpy as np
import pytest

from pipeline.causal import counterfactual
from pipeline.causal.counterfactual import NO_SINGLE_CAUSE, Removals, attribute, item_subsets, select_items
from pipeline.stats.crossed import items_held
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, random_layouts
from pipeline.world.rules import clearance, valid
from tests.factories import ITEMS, MARGINS, RULES

LAYOUTS = random_layouts(np.random.default_rng(0), 20, ITEMS, np.arange(4), RULES)
Z_THETA = random_z_theta(np.random.default_rng(1), 20, 40)
SUBSETS = item_subsets(LAYOUTS.present)


def true_removals(margins: dict) -> Removals:
    left = select_items(LAYOUTS[SUBSETS.scene], SUBSETS.kept)
    return SUBSETS.by_question(valid(left, Z_THETA[SUBSETS.scene], margins).astype(float))


@pytest.mark.parametrize("margins", [MARGINS["careful"], MARGINS["normal"]])
def test_the_only_item_too_near_is_necessary(margins: dict):
    truth = true_removals(margins)
    margin = np.array([np.nan if margins[s] is None else margins[s] for s in SYMBOLS] + [np.nan])
    near = LAYOUTS.present[:, None] & (clearance(LAYOUTS, Z_THETA) <= margin[LAYOUTS.symbol][:, None])
    invalid, single = near.any(-1), near.sum(-1) == 1
    np.testing.assert_array_equal(truth.factual == 0, invalid)
    np.testing.assert_array_equal(truth.necessity[invalid], (near & single[..., None])[invalid].astype(float))
    np.testing.assert_array_equal(attribute(truth.necessity), np.where(single, near.argmax(-1), NO_SINGLE_CAUSE))
    assert single.any() and (~single & invalid).any()


@pytest.mark.parametrize("margins", [MARGINS["careful"], MARGINS["normal"]])
def test_models_that_know_the_truth_are_never_wrong(margins: dict):
    truth = true_removals(margins)
    chances = counterfactual.baselines(attribute(truth.necessity), LAYOUTS.present, clearance(LAYOUTS, Z_THETA))
    items = items_held(LAYOUTS.item, LAYOUTS.symbol)
    of_seeds = (np.repeat(part[None], 3, axis=0) for part in (truth.factual, truth.empty, truth.without))
    row = counterfactual.score_attributions(Removals(*of_seeds), truth, chances, items)
    for name in ("right", "ci_low", "ci_high", "recall"):
        assert row[name] == 1, name
    assert row["rejected"] == (truth.factual == 0).sum() and row["empty_rejected"] == 0
    assert 1 / 3 <= row["baseline_random_item"] < row["baseline_nearest_item"] <= 1
