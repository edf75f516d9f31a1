"""Significance tests over seeds, and the verdict on an effect: an effect, negligible, present, or undecided."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.stats import wilcoxon

SMALLEST_EFFECT = 0.05  # smallest effect of interest: a change of P(valid)
SMALLEST_GAIN = 0.02  # smallest difference of interest between two models' accuracies
MIN_PAIRS = 6  # fewest pairs from which a mean difference has an interval
LEVEL = 0.05  # family-wise level of the tests, and of each one-sided equivalence test


def paired_wilcoxon(a: Float[Array, " seed"], b: Float[Array, " seed"]) -> float:
    """Return the exact two-sided signed-rank p-value of paired values; 1.0 if no pair differs.

    Equal pairs are dropped; ties share their rank. Differences are rounded to 12 decimals, so that float noise breaks
    no tie. The p-value is exact up to 13 pairs with ties, and up to 50 without.
    """
    differences = (np.asarray(a, dtype=np.float64) - b).round(12)
    return float(wilcoxon(differences).pvalue) if differences.any() else 1.0


def holm(p: Float[Array, "*family test"]) -> Float[Array, "*family test"]:
    """Return Holm's adjusted p-values (1979), family by family along the last axis.

    statsmodels' `multipletests` handles one family per call in 40 ms; a test checks that both agree.
    """
    p = np.asarray(p, dtype=np.float64)
    order = p.argsort(-1)
    stepped = np.maximum.accumulate(np.take_along_axis(p, order, -1) * np.arange(p.shape[-1], 0, -1), -1)
    return np.take_along_axis(np.minimum(stepped, 1.0), order.argsort(-1), -1)


def verdict(ci_low: float, ci_high: float, ci90_low: float, ci90_high: float, smallest: float = SMALLEST_EFFECT) -> str:
    """Return the verdict on an effect from its 95 % and 90 % intervals.

    "effect": the 95 % interval lies beyond +-`smallest`. "negligible": equivalent to zero by two one-sided tests, that
    is, the 90 % interval lies within +-`smallest` (Schuirmann, 1987). "present": neither, but the 95 % interval lies
    beyond 0. "undecided": none of these, no interval (NaN), or one of no width beside 0: without variance nothing is
    known of chance.
    """
    if ci_low == ci_high != 0:
        return "undecided"
    if ci_low > smallest or ci_high < -smallest:
        return "effect"
    if ci90_low > -smallest and ci90_high < smallest:
        return "negligible"
    return "present" if ci_low > 0 or ci_high < 0 else "undecided"
