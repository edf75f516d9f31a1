"""Scores of predicted validities against the truth: discrimination and calibration."""

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from sklearn.metrics import brier_score_loss, roc_auc_score

DECISION = 0.5  # threshold on p above which a path is accepted


def accuracy(p: Float[Array, " path"], valid: Bool[Array, " path"]) -> float:
    """Return the share of paths on the correct side of p = 0.5."""
    return float(((p > DECISION) == valid).mean())


def auroc(p: Float[Array, " path"], valid: Bool[Array, " path"]) -> float:
    """Return the probability that a valid path scores above an invalid one; NaN if all labels are equal."""
    return float("nan") if valid.all() or not valid.any() else float(roc_auc_score(valid, p))


def brier(p: Float[Array, " path"], valid: Bool[Array, " path"]) -> float:
    """Return the mean squared difference between p and the label, 0 to 1 (Brier, 1950)."""
    return float(brier_score_loss(valid, np.asarray(p, dtype=np.float64), pos_label=True))


def reliability(p: Float[Array, " path"], valid: Bool[Array, " path"], bins: int) -> pd.DataFrame:
    """Return bins of equal width, one row each: low, high, count, confidence (mean p), frequency (share valid).

    Bins are [low, high), the last one [low, 1]; means of an empty bin are NaN. sklearn's `calibration_curve` drops
    empty bins and returns no counts. ValueError if a p is outside [0, 1].
    """
    p = np.asarray(p, dtype=np.float64)
    if not ((p >= 0) & (p <= 1)).all():
        raise ValueError(f"probabilities from {p.min()} to {p.max()}: expected all of them in [0, 1]")
    edges = np.arange(bins + 1) / bins
    rows = pd.DataFrame({"bin": np.digitize(p, edges[1:-1]), "p": p, "valid": valid})
    binned = rows.groupby("bin").agg(count=("p", "size"), confidence=("p", "mean"), frequency=("valid", "mean"))
    binned = binned.reindex(range(bins))
    binned["count"] = binned["count"].fillna(0).astype(int)
    return pd.DataFrame({"low": edges[:-1], "high": edges[1:]}).join(binned)


def expected_calibration_error(p: Float[Array, " path"], valid: Bool[Array, " path"], bins: int) -> float:
    """Return the mean gap between confidence and frequency over the bins of `reliability`, weighted by their counts.

    Source: Naeini et al. (2015).
    """
    table = reliability(p, valid, bins)
    gaps = (table["confidence"] - table["frequency"]).abs()  # NaN in an empty bin, which `sum` ignores
    return float((gaps * table["count"]).sum() / table["count"].sum())
