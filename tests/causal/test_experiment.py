"""The experiment on a person: exact levels, a design that hides conditions, and stopping by the plan alone."""

from itertools import product

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng as rng

from pipeline.causal import experiment
from pipeline.causal.experiment import EXTRA, LOOKS, STICKER, UNCHANGED, design, due, local_verdicts
from pipeline.causal.paired import lower_bound, sign_flip

KINDS = ["cup", "fork"]
SCENES = np.arange(LOOKS[-1]) % 9


def outcomes(n: int, plus: float, minus: float) -> dict[tuple[int, int], float]:
    """The probability of each number of changes to 1 and to -1."""
    chance = {(0, 0): 1.0}
    for _ in range(n):
        after: dict[tuple[int, int], float] = {}
        for (a, b), p in chance.items():
            for step, q in (((1, 0), plus), ((0, 1), minus), ((0, 0), 1 - plus - minus)):
                after[a + step[0], b + step[1]] = after.get((a + step[0], b + step[1]), 0) + p * q
        chance = after
    return chance


@pytest.mark.parametrize(("plus", "minus"), [(0, 0), (0.02, 0.02), (0, 0.25), (0.1, 0.6), (0.3, 0.3), (0, 0.97)])
def test_a_bound_holds_the_true_effect_as_often_as_it_says(plus: float, minus: float):
    for n, level in product((5, 13), (0.016, 0.05)):
        chance = outcomes(n, plus, minus)
        held = sum(p for (a, b), p in chance.items() if lower_bound(a, b, n, level) <= plus - minus + 0.005)
        assert held >= 1 - level - 1e-9


def test_a_real_effect_is_called_negligible_in_at_most_one_of_twenty_over_all_looks():
    """The largest probability for an effect of just the smallest size of interest."""
    level, least, near = experiment.EQUIVALENCE_LEVEL, experiment.SMALLEST_LOCAL_EFFECT, {}
    for n in LOOKS:
        near[n] = {k for k in outcomes(n, 0, 0.25) if all(lower_bound(*o, n, level) > -least for o in (k, k[::-1]))}
    for minus in np.linspace(least, (1 + least) / 2, 21):
        chance, done, stopped = {(0, 0): 1.0}, 0, 0.0
        for n in LOOKS:
            steps, chance_now = outcomes(n - done, minus - least, minus), {}
            for ((a, b), p), ((c, d), q) in product(chance.items(), steps.items()):
                chance_now[a + c, b + d] = chance_now.get((a + c, b + d), 0) + p * q
            stopped += sum(p for k, p in chance_now.items() if k in near[n])
            chance, done = {k: p for k, p in chance_now.items() if k not in near[n]}, n
        assert stopped <= 0.05


def test_the_p_value_is_that_of_all_flips_of_scenes():
    change, scene = np.array([-1, -1, 0, -1, 1, -1, -1]), np.array([0, 0, 1, 2, 3, 4, 4])
    sums = np.bincount(scene, change)
    flips = np.array([np.dot(signs, sums) for signs in product((-1, 1), repeat=5)])
    assert sign_flip(change, scene) == pytest.approx((abs(flips) >= abs(sums.sum())).mean())
    assert sign_flip(np.zeros(5, int), np.arange(5)) == 1


def test_a_plan_asks_each_pair_once_under_each_condition_and_never_two_trials_of_a_scene_in_a_row():
    plan = design(rng(1), KINDS, SCENES, extra=[0, 1, 2, 3, 4, 5])
    first, again = plan[plan["repeats"] < 0], plan[plan["repeats"] >= 0]
    near = first[first["near"] & (first["pair"] >= 0)].groupby(["condition", "pair"]).size()
    assert (near == 1).all() and [len(near[c]) for c in (UNCHANGED, *KINDS)] == [27] * 3
    assert first.loc[first["extra"] >= 0].set_index("extra")["stage"].sort_index().tolist() == [0, 0, 0, 1, 1, 1]
    assert (first["scene"].diff() == 0).sum() <= 2, "only where a block ends"
    assert abs(len(again) / len(first) - experiment.REPEATED) < 0.02
    assert (again.index - again["repeats"] > experiment.LEAST_BETWEEN).all()
    original = plan.loc[again["repeats"]]
    assert (original[["scene", "condition"]].to_numpy() == again[["scene", "condition"]].to_numpy()).all()


def answer_all(plan: pd.DataFrame, refuses: str, most: int = 1000) -> dict[int, bool]:
    """The answers of a person who refuses this condition alone, and unchanged pictures of scene 0."""
    answers: dict[int, bool] = {}
    while len(answers) < most and (rows := due(plan, answers)):
        row = plan.loc[rows[0]]
        answers[rows[0]] = bool(row["condition"] != refuses and row["scene"] != 0)
    return answers


def test_a_kind_is_asked_until_its_verdict_stands_and_far_places_come_last():
    plan = design(rng(2), KINDS, SCENES)
    answers = answer_all(plan, "cup")
    table = local_verdicts(plan, answers).set_index("kind")
    assert (table.loc["cup", "verdict"], table.loc["fork", "verdict"]) == ("effect", "negligible")
    assert (table.loc[KINDS, "look"] == 1).all() and table.loc["cup", "pairs"] == LOOKS[0]
    assert set(plan.loc[list(answers), "stage"]) == {0, len(LOOKS)} and due(plan, answers) == []
    assert due(plan, {k: answers[k] for k in list(answers)[:7]})[0] == list(answers)[7], "an answer may be taken back"


def test_sixty_trials_hold_a_verdict_and_a_repair_and_the_other_repairs_follow_the_first_look():
    plan = design(rng(2), ["cup", "fork", "bowl", "plate"], SCENES + 1, extra=list(range(1, 19)))
    answers = answer_all(plan, "cup", 60)
    assert local_verdicts(plan, answers).set_index("kind").loc["cup", "verdict"] == "effect"
    asked = plan.loc[list(answers)]
    assert set(asked["extra"]) == {-1, 0, 1, 2} and (asked["repeats"] >= 0).any()
    rest = plan.loc[list(answer_all(plan, "cup"))]
    later = rest[rest["stage"] == 1]
    assert set(later["extra"]) == {-1, *range(3, 18)} and set(later["condition"]) == {EXTRA, UNCHANGED}, "among others"


def test_whoever_answers_yes_throughout_or_refuses_all_that_is_composited_shows_no_effect_of_a_kind():
    plan = design(rng(4), KINDS, SCENES)
    assert (local_verdicts(plan, dict.fromkeys(plan.index, True))["verdict"] == "undecided").all()
    seen = {i: bool(c == UNCHANGED) for i, c in enumerate(plan["condition"])}
    table = local_verdicts(plan, seen).set_index("kind")
    assert (table.loc[KINDS, "verdict"] == "undecided").all() and table.loc[STICKER, "verdict"] == "effect"


def test_the_average_effect_weights_near_and_far_places_by_how_often_they_are_free():
    plan = design(rng(5), KINDS, SCENES)
    answers = ((plan["condition"] != "cup") | ~plan["near"]).to_dict()
    row = experiment.average_effects(plan, answers, {"cup": 0.2}).iloc[0]
    assert row["effect"] == pytest.approx(-0.2) and (row["near_pairs"], row["far_pairs"]) == (27, 27)
    assert row["ci_low"] < -0.2 < row["ci_high"]


def test_distances_and_agreement_count_what_was_answered():
    plan = design(rng(6), KINDS, SCENES).assign(clearance_m=0.025)
    plan.loc[plan["condition"].isin([UNCHANGED, STICKER, EXTRA]), "clearance_m"] = np.nan
    answers = {i: i % 3 > 0 for i in range(60)}
    trials = experiment.answered(plan, answers)
    envelope = experiment.by_distance(trials)
    assert set(envelope["from_m"]) == {0.02} and set(envelope["kind"]) == set(KINDS)
    again = trials[trials["repeats"] >= 0]
    table = experiment.agreement(trials, trials["answer"].to_numpy()).set_index("who")
    assert table.loc["model", "share"] == 1 and table.loc["self", "count"] == len(again)
    same = np.mean([answers[r] == a for r, a in zip(again["repeats"], again["answer"], strict=True)])
    assert table.loc["self", "share"] == pytest.approx(same)
    assert 0.5 <= table.loc["ceiling", "share"] <= 1


def test_more_pairs_settle_smaller_effects():
    assert experiment.smallest_settled(13) == pytest.approx(0.22, abs=0.01)
    assert experiment.smallest_settled(27) < 0.13 and experiment.pairs_within(150, 4) == 22
