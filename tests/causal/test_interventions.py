"""Effects from arrays are what one computes by hand, and verdicts are compared with the truth."""

import numpy as np
import pandas as pd
import pytest

from pipeline.causal.interventions import compare_with_truth


def family(effects: list[float], truths: list[float], spread: float = 0.001) -> pd.DataFrame:
    """Questions whose 30 scenes and 10 seeds all show nearly the same effect, from a baseline of 0.5."""
    noise = np.random.default_rng(0).normal(0, spread, (len(effects), 10, 30))
    before, true_before = np.full_like(noise, 0.5), np.full((len(effects), 30), 0.5)
    after = before + np.array(effects)[:, None, None] + noise
    return compare_with_truth(before, after, true_before, true_before + np.array(truths)[:, None])


def test_a_row_holds_the_paired_difference_beside_the_true_one():
    row = family([-0.13], [-0.15]).iloc[0]
    assert row["effect"] == pytest.approx(-0.13, abs=0.001)
    assert row["ci_low"] < row["effect"] < row["ci_high"] < 0
    assert row["truth"] == pytest.approx(-0.15) and row["intervened"] == pytest.approx(0.37, abs=0.001)
    assert (row["verdict"], row["truth_verdict"], row["right"]) == ("effect", "effect", True)


def test_holm_corrects_for_the_whole_family():
    alone = family([-0.13], [-0.15], spread=0.7).iloc[0]
    one_of_twelve = family([-0.13] + [0.0] * 11, [-0.15] + [0.0] * 11, spread=0.7).iloc[0]
    assert 0 < alone["p_holm"] < 0.05
    assert one_of_twelve["p_holm"] == pytest.approx(12 * alone["p_holm"], abs=1e-5)


def test_an_effect_of_the_wrong_sign_is_wrong():
    table = family([-0.13, -0.13, 0.0, 0.13, 0.0], [-0.15, 0.0, -0.15, -0.15, 0.0])
    assert table["verdict"].tolist() == ["effect", "effect", "negligible", "effect", "negligible"]
    assert table["right"].tolist() == [True, False, False, False, True]


def test_a_constant_model_of_an_indifferent_user_is_right():
    ones = np.ones((4, 10, 20))
    table = compare_with_truth(ones, ones, ones[:, 0], ones[:, 0])
    assert (table[["effect", "ci_low", "ci_high"]] == 0).all(axis=None)
    assert (table["p_holm"] == 1).all() and (table["verdict"] == "negligible").all() and table["right"].all()
