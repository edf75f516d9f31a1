"""Conformal selection: accept paths such that at most a given share of them is invalid.

Held-out demonstrations calibrate a model's score s. The p-value of candidate path j, for "j is invalid", is

    p_j = (1 + number of invalid demonstrations i with s_i >= s_j) / (N + 1)

over N demonstrations. The rule of Benjamini and Hochberg then selects the paths. The expected share of invalid paths
among the accepted ones is at most the level (Jin and Candes, "Selection by Prediction with Conformal p-values", JMLR
24, 2023, Theorem 1). This holds for any model fitted without the demonstrations, if these are exchangeable with each
candidate. Demonstrations in one scene are dependent, so the guarantee is approximate in new scenes of the same kind. It
does not cover new items.

No p-value is below 1 / (N + 1): to accept a share q of the candidates takes N >= 1 / (level * q) - 1 demonstrations.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.stats import false_discovery_control

from pipeline.stats.scores import DECISION


def score(p: Float[Array, "*path"]) -> Float[Array, "*path"]:
    """Return the score that ranks paths: P(valid), with all paths that the model calls invalid tied at the bottom."""
    return np.maximum(p, DECISION)


def p_values(
    held_out: Float[Array, " demonstration"], valid: Bool[Array, " demonstration"], candidates: Float[Array, " path"]
) -> Float[Array, " path"]:
    """Return each candidate's conformal p-value of being invalid, from scores; ties count against the candidate."""
    invalid = np.sort(held_out[~valid])
    at_least = len(invalid) - np.searchsorted(invalid, candidates, side="left")
    return (1 + at_least) / (1 + len(held_out))


def accept(p: Float[Array, " path"], level: float) -> Bool[Array, " path"]:
    """Return whether Benjamini and Hochberg's step-up rule accepts each path at this level."""
    return false_discovery_control(p) <= level


def share_by_scene(part: Int[Array, "*b scene"], whole: Int[Array, "*b scene"]) -> Float[Array, "*b scene"]:
    """Return values whose mean over scenes is sum(part) / sum(whole); 0 if the whole is 0.

    The values are linearised (Cochran, 1977, Chapter 6): their variance over scenes is that of the share.
    """
    total = whole.sum(-1, keepdims=True)
    divisor = np.where(total > 0, total, 1)
    share = part.sum(-1, keepdims=True) / divisor
    return share + (part - share * whole) * whole.shape[-1] / divisor
