"""Accuracy, unsafe share and loss of decisions, where they are known."""

import numpy as np
import pytest

from pipeline.stats.decisions import accuracy_by_seed, accuracy_estimate, accuracy_loss

SHAPE = (2, 4, 6, 10)  # user, seed, scene, path
Labels = tuple[np.ndarray, np.ndarray]  # valid (user, scene, path), and the same for each seed


@pytest.fixture
def labels() -> Labels:
    valid = np.random.default_rng(0).random((SHAPE[0], *SHAPE[2:])) < 0.4
    return valid, np.broadcast_to(valid[:, None], SHAPE)


def test_right_decisions_are_accurate_and_safe_and_their_opposite_is_neither(labels: Labels):
    valid, right = labels
    best, worst = accuracy_estimate(right, valid), accuracy_estimate(~right, valid)
    assert (best["accuracy"], best["ci_low"], best["ci_high"], best["unsafe"]) == (1, 1, 1, 0)
    assert (worst["accuracy"], worst["unsafe"]) == (0, 1)


def test_without_an_invalid_path_there_is_no_unsafe_share():
    row = accuracy_estimate(np.ones(SHAPE, bool), np.ones((SHAPE[0], *SHAPE[2:]), bool))
    assert row["accuracy"] == 1 and np.isnan([row["unsafe"], row["unsafe_ci_low"], row["unsafe_ci_high"]]).all()


def test_the_loss_is_the_difference_of_accuracies_even_if_the_truth_changes(labels: Labels):
    valid, right = labels
    rng = np.random.default_rng(2)
    fuller, decisions = valid & (rng.random(valid.shape) < 0.5), right ^ (rng.random(SHAPE) < 0.2)
    row = accuracy_loss(decisions, fuller, right, valid)
    assert row["loss"] == pytest.approx(1 - accuracy_estimate(decisions, fuller)["accuracy"])
    assert 0 < row["loss_ci_low"] < row["loss"] < row["loss_ci_high"]


def test_accuracy_by_seed_has_a_row_a_user_and_seed_and_averages_to_the_estimate(labels: Labels):
    valid, _ = labels
    p = np.random.default_rng(4).random(SHAPE)
    table = accuracy_by_seed(p, valid, ["careful", "normal"], [0, 1, 2, 3])
    assert list(table["user"]) == ["careful"] * 4 + ["normal"] * 4 and list(table["seed"]) == [0, 1, 2, 3] * 2
    assert table["accuracy"].mean() == pytest.approx(accuracy_estimate(p > 0.5, valid)["accuracy"])
    assert table["auroc"].between(0.3, 0.7).all()
