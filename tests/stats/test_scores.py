"""Scores agree with scikit-learn's, and calibration error measures calibration."""

import numpy as np
import pytest
from sklearn.calibration import calibration_curve
from sklearn.metrics import accuracy_score, brier_score_loss, roc_auc_score

from pipeline.stats.scores import accuracy, auroc, brier, reliability


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
