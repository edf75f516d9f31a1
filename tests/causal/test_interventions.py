"""Effects from arrays are what one computes by hand, and the verdicts are held against the truth."""

import numpy as np
import pytest

from pipeline.causal.interventions import expected_validity, ordered_pairs, over_placements, study, tally

USERS = ["careful", "normal", "aggressive"]


def family(
    effects: list[float], truths: list[float], seeds: int = 10, scenes: int = 30, spread: float = 0.001
) -> list[dict]:
    """Cells whose scenes and seeds all show nearly the same effect, from a baseline of .5."""
    noise = np.random.default_rng(0).normal(0, spread, (len(effects), seeds, scenes))
    before, true_before = np.full_like(noise, 0.5), np.full((len(effects), scenes), 0.5)
    after = before + np.array(effects)[:, None, None] + noise
    true_after = true_before + np.array(truths)[:, None]
    return study(before, after, true_before, true_after)


def test_an_expectation_is_the_mean_probability():
    np.testing.assert_allclose(expected_validity(np.array([[0.0, 1.0, 0.5, 0.5], [1, 1, 1, 0]])), [0.5, 0.75])


def test_placements_are_averaged_within_their_scene():
    intervened = np.array([[[0.1, 0.2], [0.3, 0.4]]])  # one symbol, two placements, two scenes
    np.testing.assert_allclose(over_placements(intervened), [[0.2, 0.3]])


def test_every_user_is_swapped_for_every_other():
    assert len(ordered_pairs(USERS)) == 6
    assert ("careful", "normal") in ordered_pairs(USERS)
    assert ("normal", "careful") in ordered_pairs(USERS)


def test_a_cell_reports_the_paired_difference_beside_the_true_one():
    cell = family([-0.13], [-0.15])[0]
    assert abs(cell["effect"] + 0.13) < 0.001
    assert cell["ci_low"] < cell["effect"] < cell["ci_high"] < 0
    assert cell["truth"] == -0.15
    assert cell["truth_intervened"] == 0.35
    assert (cell["verdict"], cell["truth_verdict"], cell["right"]) == ("effect", "effect", True)


def test_holm_pays_for_the_whole_family():
    alone = family([-0.13], [-0.15], spread=0.7)[0]
    one_of_twelve = family([-0.13] + [0.0] * 11, [-0.15] + [0.0] * 11, spread=0.7)[0]
    assert 0 < alone["p_holm"] < 0.05
    assert one_of_twelve["p_holm"] == pytest.approx(12 * alone["p_holm"], abs=1e-5)


def test_the_tally_tells_false_causes_from_missed_ones():
    cells = family([-0.13, -0.13, 0.0, 0.13, 0.0], [-0.15, 0.0, -0.15, -0.15, 0.0])
    assert [c["right"] for c in cells] == [True, False, False, False, True]  # the fourth has the wrong sign
    assert tally(cells) == {"cells": 5, "right": 2, "false_causes": 2, "missed_causes": 1, "undecided": 0}


def test_a_constant_model_of_a_user_who_minds_nothing_is_right():
    ones = np.ones((4, 10, 20))
    cells = study(ones, ones, ones[:, 0], ones[:, 0])
    assert {(c["effect"], c["ci_low"], c["ci_high"], c["p_holm"], c["verdict"]) for c in cells} == {
        (0.0, 0.0, 0.0, 1.0, "negligible")
    }
    assert tally(cells)["right"] == 4
