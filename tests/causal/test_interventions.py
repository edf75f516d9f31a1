"""Effects from arrays are what one computes by hand; verdicts and bold cells follow from them."""

import numpy as np
import pandas as pd
import pytest

from pipeline.causal import interventions
from pipeline.causal.interventions import NONE, PAPER_BOLD, asked, bold_rows, compare_with_truth, right_verdicts
from pipeline.world.layout import SYMBOLS
from pipeline.world.rules import PAPER_P_VALID

SEEDS, SCENES = 10, 60
CHANGES = [(user, symbol) for user, row in PAPER_P_VALID.items() for symbol in row if symbol != NONE]


def family(effects: list[float], truths: list[float], spread: float = 0.001) -> pd.DataFrame:
    """Questions whose 30 scenes and 10 seeds all show nearly the same effect, from a baseline of 0.5."""
    noise = np.random.default_rng(0).normal(0, spread, (len(effects), 10, 30))
    before, true_before = np.full_like(noise, 0.5), np.full((len(effects), 30), 0.5)
    after = before + np.array(effects)[:, None, None] + noise
    return compare_with_truth(before, after, true_before, true_before + np.array(truths)[:, None])


def test_a_question_compares_the_scene_as_it_is_with_its_symbol_s_version():
    users = ["careful", "normal"]
    p = np.random.default_rng(11).random((2, 3, 1 + len(SYMBOLS), 5, 6))  # user, seed, version, scene, path
    before, after = interventions.expected_by_version(p)
    for i, (user, symbol) in interventions.questions(users).iterrows():
        row = p[users.index(user)]
        np.testing.assert_allclose(before[i], row[:, 0].mean(-1))
        np.testing.assert_allclose(after[i], row[:, 1 + SYMBOLS.index(symbol)].mean(-1))
    np.testing.assert_allclose(interventions.added_item_effects(p), after - before)


def test_holm_corrects_for_the_whole_family():
    alone = family([-0.13], [-0.15], spread=0.7).iloc[0]
    one_of_twelve = family([-0.13] + [0.0] * 11, [-0.15] + [0.0] * 11, spread=0.7).iloc[0]
    assert 0 < alone["p_holm"] < 0.05
    assert one_of_twelve["p_holm"] == pytest.approx(12 * alone["p_holm"], abs=1e-5)


def test_an_effect_of_the_wrong_sign_is_wrong_and_only_users_whose_results_are_averaged_count():
    table = family([-0.13, -0.13, 0.0, 0.13, 0.0], [-0.15, 0.0, -0.15, -0.15, 0.0])
    assert table["verdict"].tolist() == ["effect", "effect", "negligible", "effect", "negligible"]
    assert table["right"].tolist() == [True, False, False, False, True]
    table = table.assign(kind=["add", "add", "add", "user", "add"], variant="full", user=[*"aaab", "c"])
    assert len(asked(table, "add", ["a"])) == 3 and right_verdicts(table, "add", ["a"]) == {"full": 1}
    assert right_verdicts(table, "add", ["a", "c"]) == {"full": 2} and right_verdicts(table, "user", []) == {"full": 0}


def test_a_constant_model_of_an_indifferent_user_is_right_and_nothing_is_bold():
    ones = np.ones((4, SEEDS, SCENES))
    table = compare_with_truth(ones, ones, ones[:, 0], ones[:, 0])
    assert (table[["effect", "ci_low", "ci_high"]] == 0).all(axis=None)
    assert (table["p_holm"] == 1).all() and (table["verdict"] == "negligible").all() and table["right"].all()
    assert not bold_rows("learner", [c for c in CHANGES if c[0] == "aggressive"], ones, ones)["bold"].any()


def as_in_the_paper(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """P(valid) of a learner that reacts to what the paper prints in bold, and to nothing else."""
    baseline = rng.uniform(0.3, 0.7, (3, 1, SCENES)) + rng.normal(0, 0.02, (3, SEEDS, SCENES))
    baseline = np.repeat(baseline, 4, axis=0)  # the changes of a user share their scenes
    effect = np.array([-0.15 if change in PAPER_BOLD else 0.0 for change in CHANGES])[:, None, None]
    return baseline, baseline + effect + rng.normal(0, 0.05, baseline.shape)


def test_a_cell_is_bold_if_and_only_if_its_p_after_holm_over_the_learner_s_changes_is_below_5_per_cent():
    baseline, intervened = as_in_the_paper(np.random.default_rng(0))
    rows = bold_rows("learner", CHANGES, baseline, intervened)
    changed = rows[rows["change"] != NONE]
    assert len(rows) == 15 and (changed["bold"] == (changed["p_holm"] < 0.05)).all()
    assert not rows.loc[rows["change"] == NONE, "bold"].any()
    assert set(changed.loc[changed["bold"], ["user", "change"]].itertuples(index=False, name=None)) == PAPER_BOLD
    assert interventions.cells_as_in_the_paper(rows) == {"learner": 12}


def test_scenes_shuffled_between_the_arms_unbold_every_cell():
    rng = np.random.default_rng(1)
    baseline, intervened = as_in_the_paper(rng)
    swapped = rng.random((1, 1, SCENES)) < 0.5
    arms = np.where(swapped, intervened, baseline), np.where(swapped, baseline, intervened)
    rows = bold_rows("learner", CHANGES, *arms)
    assert not rows["bold"].any()
    assert interventions.cells_as_in_the_paper(rows) == {"learner": 7}  # as for a model that never looks


def test_a_mark_needs_the_interval_beyond_the_smallest_effect_and_not_a_small_p_alone():
    baseline = np.full((1, SEEDS, SCENES), 0.5) + np.random.default_rng(3).normal(0, 1e-3, (1, SEEDS, SCENES))
    for effect, beyond in ((-0.02, False), (-0.08, True)):
        rows = bold_rows("learner", [("careful", "bowl")], baseline, baseline[:, ::-1] + effect)
        assert rows["bold"].iloc[1] and rows["beyond"].iloc[1] == beyond
