"""Accuracy and its change, where they are known."""

import numpy as np
import pytest

from studies.robustness.losses import change, more_accepted, score

SHAPE = (2, 4, 6, 10)  # user, seed, scene, path


def known(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Paths' validity, and what a model told the truth says of it."""
    valid = np.random.default_rng(seed).random((SHAPE[0], *SHAPE[2:])) < 0.4
    return valid, np.broadcast_to(valid[:, None], SHAPE)


def test_a_model_told_the_truth_makes_no_mistake_and_its_opposite_nothing_else():
    valid, told = known()
    right, wrong = score(told, valid), score(~told, valid)
    assert right["accuracy"] == {"mean": 1.0, "q1": 1.0, "q3": 1.0} and right["by_user"] == [1.0, 1.0]
    assert (right["false_rejects"], right["false_accepts"]) == (0.0, 0.0)
    assert wrong["accuracy"]["mean"] == 0.0 and (wrong["false_rejects"], wrong["false_accepts"]) == (1.0, 1.0)


def test_a_model_that_accepts_everything_is_right_as_often_as_paths_are_valid():
    valid, _ = known()
    cell = score(np.ones(SHAPE, bool), valid)
    assert cell["accuracy"]["mean"] == pytest.approx(valid.mean(), abs=1e-6)
    assert (cell["false_rejects"], cell["false_accepts"]) == (0.0, 1.0)


def test_where_every_path_is_valid_none_can_be_accepted_wrongly():
    cell = score(np.ones(SHAPE, bool), np.ones((SHAPE[0], *SHAPE[2:]), bool))
    assert cell["false_accepts"] is None and cell["false_rejects"] == 0.0


def test_what_changes_nothing_changes_accuracy_by_nothing():
    valid, told = known()
    guesses = np.random.default_rng(1).random(SHAPE) < 0.5
    assert change(guesses, valid, guesses, valid) == {"difference": 0.0, "ci_low": 0.0, "ci_high": 0.0}
    fall = change(~told, valid, told, valid)
    assert fall["difference"] == -1.0


def test_the_change_is_the_difference_of_the_accuracies_and_lies_in_its_interval():
    valid, told = known()
    rng = np.random.default_rng(2)
    some = told ^ (rng.random(SHAPE) < 0.2)
    cell = change(some, valid, told, valid)
    assert cell["difference"] == pytest.approx(score(some, valid)["accuracy"]["mean"] - 1, abs=2e-6)
    assert cell["ci_low"] < cell["difference"] < cell["ci_high"] < 0


def test_other_scenes_may_hold_other_truths():
    """More items make other paths invalid: the model is held to the truth of the table it sees."""
    valid, told = known()
    fuller = valid & (np.random.default_rng(3).random(valid.shape) < 0.5)
    blind = change(told, fuller, told, valid)
    assert blind["difference"] == pytest.approx((fuller == valid).mean() - 1, abs=1e-6)


def test_the_share_of_invalid_paths_accepted_lies_in_its_interval_which_other_scenes_widen():
    valid, told = known()
    rng = np.random.default_rng(3)
    even = told | (rng.random(SHAPE) < 0.3)
    uneven = told | (rng.random((1, 1, SHAPE[2], 1)) < 0.3)  # everything in some scenes, nothing in others
    widths = []
    for accepted in (even, uneven):
        cell = score(accepted, valid)
        low, high = cell["false_accepts_ci"]
        assert low < cell["false_accepts"] < high
        widths.append(high - low)
    assert widths[1] > 2 * widths[0]
    assert score(told, np.ones_like(valid))["false_accepts_ci"] is None


def test_what_more_of_the_invalid_paths_is_accepted_has_an_interval_of_its_own():
    """The change is paired: what both accept alike says nothing of it, however much that varies between scenes."""
    valid, told = known()
    rng = np.random.default_rng(4)
    before = told | (rng.random((1, 1, SHAPE[2], 1)) < 0.5)
    after = before | (rng.random(SHAPE) < 0.2)
    more = more_accepted(after, valid, before, valid)
    assert more is not None
    share = score(after, valid)["false_accepts"] - score(before, valid)["false_accepts"]
    assert more["difference"] == pytest.approx(share, abs=1e-6) and more["ci_low"] < share < more["ci_high"]
    low, high = score(after, valid)["false_accepts_ci"]
    assert more["ci_high"] - more["ci_low"] < 0.7 * (high - low)
    assert more_accepted(before, valid, before, valid) == {"difference": 0.0, "ci_low": 0.0, "ci_high": 0.0}
    assert more_accepted(told, np.ones_like(valid), told, valid) is None


def test_a_fuller_table_is_asked_about_its_own_invalid_paths():
    valid, told = known()
    fuller = valid & (np.random.default_rng(3).random(valid.shape) < 0.5)
    more = more_accepted(told, fuller, told, valid)
    shares = [score(told, truth)["false_accepts"] for truth in (fuller, valid)]
    assert more is not None and more["difference"] == pytest.approx(shares[0] - shares[1], abs=2e-6)
