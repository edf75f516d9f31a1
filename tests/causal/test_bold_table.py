"""A cell of Table 2 is bold if and only if the change against no intervention is significant."""

import numpy as np

from pipeline.causal.bold_table import (
    NONE,
    PAPER,
    PAPER_BOLD,
    bold_rows,
    cells_as_in_the_paper,
    paper_rows,
)
from pipeline.causal.interventions import estimate_effects
from pipeline.world.rules import PAPER_P_VALID

SEEDS, SCENES = 10, 60
CHANGES = [(user, symbol) for user, row in PAPER_P_VALID.items() for symbol in row if symbol != NONE]


def answers(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """P(valid) of a learner that reacts to what the paper prints in bold, and to nothing else."""
    baseline = rng.uniform(0.3, 0.7, (3, 1, SCENES)) + rng.normal(0, 0.02, (3, SEEDS, SCENES))
    baseline = np.repeat(baseline, 4, axis=0)  # the changes of a user share their scenes
    effect = np.array([-0.15 if change in PAPER_BOLD else 0.0 for change in CHANGES])[:, None, None]
    return baseline, baseline + effect + rng.normal(0, 0.05, baseline.shape)


def test_a_cell_is_bold_if_and_only_if_its_p_after_holm_over_the_learner_s_changes_is_below_5_per_cent():
    baseline, intervened = answers(np.random.default_rng(0))
    rows = bold_rows("learner", CHANGES, baseline, intervened)
    changed = rows[rows["change"] != NONE]
    assert len(rows) == 15 and (changed["bold"] == (changed["p_holm"] < 0.05)).all()
    assert not rows.loc[rows["change"] == NONE, "bold"].any()
    np.testing.assert_allclose(changed["p_holm"], estimate_effects(intervened - baseline)["p_holm"])
    assert set(changed.loc[changed["bold"], ["user", "change"]].itertuples(index=False, name=None)) == PAPER_BOLD
    assert cells_as_in_the_paper(rows) == {"learner": 12}


def test_scenes_shuffled_between_the_arms_unbold_every_cell():
    rng = np.random.default_rng(1)
    baseline, intervened = answers(rng)
    swapped = rng.random((1, 1, SCENES)) < 0.5
    arms = np.where(swapped, intervened, baseline), np.where(swapped, baseline, intervened)
    rows = bold_rows("learner", CHANGES, *arms)
    assert not rows["bold"].any()
    assert cells_as_in_the_paper(rows) == {"learner": 7}  # as for a model that never looks


def test_quartiles_are_over_training_sets_and_over_scenes_for_the_truth():
    baseline, intervened = answers(np.random.default_rng(2))
    rows = bold_rows("learner", CHANGES, baseline, intervened).set_index(["user", "change"])
    by_seed = intervened[CHANGES.index(("normal", "glass"))].mean(-1)
    expected = [by_seed.mean(), *np.quantile(by_seed, (0.25, 0.75))]
    np.testing.assert_allclose(rows.loc[("normal", "glass"), ["mean", "q1", "q3"]].astype(float), expected)
    one = bold_rows("truth", CHANGES, baseline[:, :1], intervened[:, :1]).set_index(["user", "change"])
    by_scene = baseline[0, 0]
    expected = np.quantile(by_scene, (0.25, 0.75))
    np.testing.assert_allclose(one.loc[("careful", NONE), ["q1", "q3"]].astype(float), expected)


def test_a_mark_needs_the_interval_beyond_the_smallest_effect_and_not_a_small_p_alone():
    baseline = np.full((1, SEEDS, SCENES), 0.5) + np.random.default_rng(3).normal(0, 1e-3, (1, SEEDS, SCENES))
    for effect, beyond in ((-0.02, False), (-0.08, True)):
        rows = bold_rows("learner", [("careful", "bowl")], baseline, baseline[:, ::-1] + effect)
        assert rows["bold"].iloc[1] and rows["beyond"].iloc[1] == beyond


def test_an_effect_of_exactly_zero_is_never_bold():
    baseline = np.ones((4, SEEDS, SCENES))
    rows = bold_rows("learner", [c for c in CHANGES if c[0] == "aggressive"], baseline, baseline)
    assert not rows["bold"].any() and rows["p_holm"].dropna().eq(1).all()


def test_the_paper_s_block_has_its_five_bold_cells_and_only_users_and_symbols_of_this_run():
    rows = paper_rows(["careful", "normal", "aggressive", "tidy"], ["bowl", "plate", "cutlery", "glass", "vase"])
    assert len(rows) == 15 and rows["bold"].sum() == 5 and cells_as_in_the_paper(rows) == {PAPER: 12}
    few = paper_rows(["normal"], ["glass"])
    assert few["change"].tolist() == [NONE, "glass"] and few["mean"].tolist() == [0.62, 0.48]
