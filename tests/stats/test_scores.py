"""Scores agree with scikit-learn's, and calibration error measures calibration."""

import numpy as np
import pytest
from sklearn.calibration import calibration_curve
from sklearn.metrics import accuracy_score, brier_score_loss, roc_auc_score

from pipeline.stats.scores import (
    accuracy,
    accuracy_estimate,
    auroc,
    brier,
    expected_calibration_error,
    reliability,
)


def drawn(seed: int, paths: int) -> tuple[np.ndarray, np.ndarray]:
    """Perfectly calibrated: each path is valid with exactly the chance predicted."""
    rng = np.random.default_rng(seed)
    p = rng.random(paths)
    return p, rng.random(paths) < p


def test_scores_and_reliability_agree_with_scikit_learn():
    p, valid = drawn(0, 500)
    assert accuracy(p, valid) == pytest.approx(accuracy_score(valid, p > 0.5))
    assert auroc(p, valid) == pytest.approx(roc_auc_score(valid, p))
    assert brier(p, valid) == pytest.approx(brier_score_loss(valid, p))
    p, valid = drawn(1, 2000)
    r = reliability(p, valid, 10)
    frequency, confidence = calibration_curve(valid, p, n_bins=10)
    np.testing.assert_allclose(r.frequency, frequency)
    np.testing.assert_allclose(r.confidence, confidence)
    assert r["count"].sum() == 2000
    assert ((r.low <= r.confidence) & (r.confidence <= r.high)).all()


def test_the_error_of_a_calibrated_generator_tends_to_zero():
    few, many = (expected_calibration_error(*drawn(2, paths), 10) for paths in (100, 1_000_000))
    assert many < 0.005 < few


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
