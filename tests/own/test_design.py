"""Which table separates rules best: what a path asks of each rule, and what an answer leaves of them."""

import numpy as np
import pytest
from numpy.random import default_rng as rng

from pipeline.own.design import LAPSES, MARGINS_M, MOST_RULES, VARIANTS, Rules, by_family, evenly, of_members, question

UPWARDS = evenly(np.array([[0.5, 0.1], [0.5, 0.9]]), 81)


def beside(x: float, y: float, *others: tuple[float, float]) -> np.ndarray:
    """What the path upwards asks about a disc of 3 cm of kind 0 at a place; others are discs of no kind."""
    centres = np.array([(x, y), *others])
    kind = np.array([0, *[-1] * len(others)])
    return question(UPWARDS, np.stack([centres, centres], 1), np.full(len(centres), 0.03), kind, 1)[:, 0]


@pytest.mark.parametrize(
    ("place", "counted"),
    [
        ((0.55, 0.3), {"on the right of the path", "in the first half of the path"}),
        ((0.45, 0.7), {"on the left of the path", "in the second half of the path"}),
    ],
)
def test_a_variant_counts_an_item_where_it_says(place: tuple[float, float], counted: set[str]):
    counted |= {"anywhere", "away from other items"}
    asked = dict(zip(VARIANTS, beside(*place), strict=True))
    assert asked.pop("beside a tenth of the path") == pytest.approx(np.hypot(0.05, 0.04) - 0.03, abs=1e-3)
    assert {name for name, margin in asked.items() if margin < np.inf} == counted
    assert [asked[name] for name in counted] == pytest.approx([0.02] * 4)


def test_an_item_beside_another_is_not_on_its_own():
    asked = dict(zip(VARIANTS, beside(0.55, 0.3, (0.68, 0.3)), strict=True))
    assert asked["beside another item"] < asked["away from other items"] == np.inf


def test_information_is_largest_where_half_of_the_rules_accept_and_answers_leave_the_true_rule():
    rules, asked = Rules.unknown(2, rng(0)), rng(1).uniform(0, 0.08, (60, len(VARIANTS), 2))
    accepted = rules.accept(asked)
    share = accepted.mean(1)
    assert rules.information(accepted).argmax() == np.abs(rules.weight @ accepted.T - 0.5).argmin()
    assert rules.information(np.ones((1, len(rules.variant))))[0] == 0 and 0 < share.min() < 0.5 < share.max()
    true = int(np.flatnonzero((rules.variant == 3) & (rules.margin == [4, 0]).all(1))[0])
    for _ in range(60):
        row = int(rules.information(accepted).argmax())
        rules = rules.told(accepted[row], bool(accepted[row, true]))
    variant, margin = rules.known()
    assert (variant.argmax(), *margin.argmax(1)) == (3, 4, 0) and rules.weight[true] > 0.9


def test_an_answer_weighs_a_rule_by_the_share_of_lapses():
    rules = Rules.unknown(1, rng(0))
    after = rules.told(rules.margin[:, 0] == 0, False)
    assert after.weight[rules.margin[:, 0] == 0].sum() == pytest.approx(LAPSES / (LAPSES + (1 - LAPSES) * 6))


def test_many_kinds_are_drawn_from_the_prior():
    variant, margin = (rules := Rules.unknown(7, rng(2))).known()
    assert len(rules.weight) == MOST_RULES
    np.testing.assert_allclose(margin, 1 / len(MARGINS_M), atol=0.02)
    assert variant[0] == pytest.approx(1 / 5, abs=0.02)


def test_members_that_keep_three_centimetres_make_that_margin_likely_and_none_impossible():
    clearances = np.linspace(0.002, 0.09, 40)
    margin = of_members(clearances, np.repeat(clearances[:, None] >= 0.03, 5, 1))
    assert margin.argmax() == 3 and margin.min() == pytest.approx(1 / 14) and margin.sum() == pytest.approx(1)
    variant = by_family({"margin": 1.0})
    assert variant[0] == pytest.approx(0.6) and variant.min() > 0 and variant.sum() == pytest.approx(1)
