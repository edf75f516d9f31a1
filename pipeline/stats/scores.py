"""How good predicted validities are against the truth: discrimination, sharpness and calibration."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

DECISION = 0.5  # a path is called valid if p exceeds it


@dataclass(frozen=True)
class Reliability:
    """Predictions by bins of equal width over [0, 1]; means are NaN where a bin is empty."""

    low: Float[Array, " bin"]  # a bin is [low, high), the last one [low, 1]
    high: Float[Array, " bin"]
    count: Int[Array, " bin"]
    confidence: Float[Array, " bin"]  # mean p
    frequency: Float[Array, " bin"]  # share truly valid


def accuracy(p: Float[Array, " path"], valid: Bool[Array, " path"]) -> float:
    """Share of paths on the right side of p = .5."""
    return float(((p > DECISION) == valid).mean())


def auroc(p: Float[Array, " path"], valid: Bool[Array, " path"]) -> float:
    """Chance that a valid path scores above an invalid one; NaN if there is only one kind."""
    if valid.all() or not valid.any():
        return float("nan")
    from sklearn.metrics import roc_auc_score  # takes a second and a half, in every stage and worker

    return float(roc_auc_score(valid, p))


def brier(p: Float[Array, " path"], valid: Bool[Array, " path"]) -> float:
    """Mean squared difference between p and the truth, 0 to 1 (Brier 1950)."""
    return float(((np.asarray(p, dtype=np.float64) - valid) ** 2).mean())


def reliability(p: Float[Array, " path"], valid: Bool[Array, " path"], bins: int) -> Reliability:
    """Mean prediction beside the share truly valid, in `bins` bins of equal width.

    Raises ValueError if a p is not in [0, 1].
    """
    p = np.asarray(p, dtype=np.float64)
    if not ((p >= 0) & (p <= 1)).all():
        raise ValueError(f"probabilities from {p.min()} to {p.max()}: expected all of them in [0, 1]")
    index = np.minimum((p * bins).astype(int), bins - 1)
    count = np.bincount(index, minlength=bins)
    with np.errstate(invalid="ignore"):
        confidence = np.bincount(index, p, bins) / count
        frequency = np.bincount(index, valid, bins) / count
    edges = np.arange(bins + 1) / bins
    return Reliability(edges[:-1], edges[1:], count, confidence, frequency)


def expected_calibration_error(p: Float[Array, " path"], valid: Bool[Array, " path"], bins: int) -> float:
    """Mean gap between prediction and frequency over `bins` bins of equal width, weighted by their counts.

    Naeini et al. 2015, with the bins of `reliability`.
    """
    r = reliability(p, valid, bins)
    gap = np.where(r.count > 0, np.abs(r.confidence - r.frequency), 0.0)
    return float((gap * r.count).sum() / r.count.sum())
