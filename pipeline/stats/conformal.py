"""Which paths to accept, so that at most a promised share of the accepted ones is invalid: conformal selection.

Held-out demonstrations calibrate a model's score s. The p-value of a candidate path j, small if it is hardly invalid,

    p_j = (1 + the number of invalid demonstrations i with s_i >= s_j) / (N + 1),

has all N demonstrations below and only invalid ones above; Benjamini and Hochberg's step-up rule (BH) then picks the
paths (Jin and Candes, "Selection by Prediction with Conformal p-values", JMLR 24, 2023). The false discovery rate
E[invalid among accepted / accepted], the quotient 0 where none is, is the level at most, for any N, any model and any
share of invalid paths. For let j be invalid and accepted, and count it for the other paths as one more demonstration in
the place of the 1. The p-values of paths that score no higher stay; those of paths that score higher can only fall, and
these are accepted anyway. So how many are accepted depends on the demonstrations and j as a set, in which j's rank is
uniform. Ties count against the path, as here, so that its p is never too small.

The score is P(valid), cut off below at one half (`score`): what the model itself finds invalid is level in the last
place, so that none of these paths is accepted unless all are. (In the cross-fitted form each of several models has its
say, and a laxer promise outweighs one of them.) A score may be anything that is fixed beforehand.

What it assumes: the score was fitted without the demonstrations, and these are exchangeable with each candidate path.
Neither the demonstrations nor the paths of one scene are independent of one another, so that in new scenes of the same
kind the assumption holds nearly, not exactly. With whole scenes as units it would hold, but 20 scenes give no p below
1/21. With items never seen it does not hold at all. Labels are of the lines that hands drew, the candidates are Bezier
paths: where these disagree (metrics.json of stage demos says how rarely), the promise is of what a hand would draw.
"""

from collections.abc import Sequence
from math import ceil, log
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.stats import false_discovery_control

from pipeline.stats.scores import DECISION


class Calibration(NamedTuple):
    """Scores by one model: of demonstrations it was not fitted to, beside their labels, and of the candidate paths."""

    held_out: Float[Array, " demonstration"]
    valid: Bool[Array, " demonstration"]
    candidates: Float[Array, " path"]


def score(p: Float[Array, "*path"]) -> Float[Array, "*path"]:
    """What paths are ranked by, from P(valid): all that the model itself finds invalid come last, and are level."""
    return np.maximum(p, DECISION)


def p_values(parts: Sequence[Calibration]) -> Float[Array, " path"]:
    """Conformal p-value of every candidate path being invalid.

    One part, of a model fitted to other demonstrations, is the split form: given the assumption, its promise is exact.
    Several, each of a model fitted to the others' demonstrations, pool their counts (cross-conformal prediction, Vovk
    2015): every label calibrates, but no level is promised.
    """
    invalid = np.sum([_at_least(np.sort(part.held_out[~part.valid]), part.candidates) for part in parts], axis=0)
    return (1 + invalid) / (1 + sum(len(part.held_out) for part in parts))


def _at_least(ascending: Float[Array, " demonstration"], scores: Float[Array, " path"]) -> Array:
    """How many demonstrations score as high as each path, or higher."""
    return len(ascending) - np.searchsorted(ascending, scores, side="left")


def accept(p: Float[Array, " path"], level: float) -> Bool[Array, " path"]:
    """The paths that BH's step-up rule accepts; the higher the level, the more."""
    return false_discovery_control(p) <= level


def accept_knowing(scores: Float[Array, " path"], valid: Bool[Array, " path"], level: float) -> Bool[Array, " path"]:
    """The most paths above one threshold, at most a share `level` of them invalid: what who knows the truth accepts."""
    thresholds = np.unique(scores)
    accepted = len(scores) - np.searchsorted(np.sort(scores), thresholds)
    invalid = _at_least(np.sort(scores[~valid]), thresholds)
    good = thresholds[invalid <= level * accepted]
    return scores >= (good.min() if len(good) else np.inf)


def fewest_demonstrations(level: float, share: float) -> int:
    """Least N whose smallest p, 1/(N + 1), lets BH accept a share of the candidate paths."""
    return ceil(round(1 / (level * share), 9)) - 1


def fewest_without_error(level: float, error: float) -> int:
    """Least number of accepted demonstrations, none invalid, that shows the share of invalid ones to be below `level`.

    With confidence 1 - error (exact binomial test): the promise for this very threshold that learn-then-test makes
    (Angelopoulos et al. 2021), where an expectation over thresholds is all that the false discovery rate is.
    """
    return ceil(log(error) / log(1 - level))


def by_scene(part: Int[Array, "*b scene"], whole: Int[Array, "*b scene"]) -> Float[Array, "*b scene"]:
    """Each scene's say in the share sum(part) / sum(whole): their mean is the share, 0 where `whole` is.

    Linearised around it (Cochran, 1977, Chapter 6), so that they spread over scenes as the share does.
    """
    total = whole.sum(-1, keepdims=True)
    some = np.where(total > 0, total, 1)
    share = part.sum(-1, keepdims=True) / some
    return share + (part - share * whole) * whole.shape[-1] / some
