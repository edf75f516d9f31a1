"""Exact statistics of paired answers: bounds of the mean change, and the p-value of no change."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.special import gammaln, stdtrit

DELTAS = np.linspace(-1, 1, 201)
Change = Int[Array, " pair"]  # of the answer with the item over that without: -1, 0 or 1
Scenes = Int[Array, " pair"]


def interval(change: Change, scene: Scenes, level: float) -> tuple[float, float]:
    """Return bounds of the mean change, each one-sided at `level`: exact over pairs and, if scenes repeat, over scenes.

    Pairs of one scene depend on one another. Then the bounds are at least as wide as Student's over scenes, of a ratio
    (Cochran, 1977, Chapter 6). Without a pair they are -1 and 1.
    """
    n, plus, minus = len(change), int((change > 0).sum()), int((change < 0).sum())
    if not n:
        return -1.0, 1.0
    low, high = lower_bound(plus, minus, n, level), -lower_bound(minus, plus, n, level)
    counts = np.bincount(scene)
    counts, sums = counts[counts > 0], np.bincount(scene, change)[counts > 0]
    if counts.max() > 1 and len(counts) > 1:
        k, mean = len(counts), change.mean()
        error = np.sqrt(k / (k - 1) * ((sums - mean * counts) ** 2).sum()) / n
        reach = stdtrit(k - 1, 1 - level) * error
        low, high = min(low, max(mean - reach, -1)), max(high, min(mean + reach, 1))
    return float(low), float(high)


@lru_cache(maxsize=100_000)
def lower_bound(plus: int, minus: int, n: int, level: float) -> float:
    """Return the exact one-sided lower bound of E[change] where `plus` of n independent changes are 1, `minus` -1.

    It inverts the unconditional test with the score statistic (Tango, 1998), whose p-value is the largest over the
    share of changes (Hsueh, Liu and Chen, 2001). Bounds are interpolated in steps of .01.
    """
    p = _p_values(n)[plus, minus]
    first = int((p > level).argmax())
    if first == 0:
        return -1.0
    share = (level - p[first - 1]) / (p[first] - p[first - 1])
    return float(DELTAS[first - 1] + share * (DELTAS[first] - DELTAS[first - 1]))


@lru_cache(maxsize=256)
def _p_values(n: int) -> Float[Array, "plus minus delta"]:
    """Return the p-value of E[change] <= delta for each outcome of n changes, against greater ones."""
    plus, minus = np.array([(i, j) for i in range(n + 1) for j in range(n + 1 - i)]).T
    ways = gammaln(n + 1) - gammaln(plus + 1) - gammaln(minus + 1) - gammaln(n - plus - minus + 1)
    p = np.ones((n + 1, n + 1, len(DELTAS)))
    for k, delta in enumerate(DELTAS):
        b, c = -plus - minus + (2 * n - plus + minus) * delta, -minus * delta * (1 - delta)
        q = (np.sqrt(np.maximum(b**2 - 8 * n * c, 0)) - b) / (4 * n)  # likeliest P(change = -1) under this delta
        variance = n * (2 * q + delta * (1 - delta))
        z = ((plus - minus - n * delta) / np.sqrt(np.maximum(variance, 1e-12))).round(9)
        shares = np.linspace(max(0, -delta), (1 - delta) / 2, 31)  # of changes to -1
        logs = np.log(np.maximum([shares + delta, shares, 1 - 2 * shares - delta], 1e-300))
        chance = np.exp(ways[:, None] + np.stack([plus, minus, n - plus - minus], -1) @ logs)  # (outcome, share)
        order = np.argsort(-z, kind="stable")
        last = np.searchsorted(-z[order], -z[order], side="right") - 1  # of the outcomes that tie
        p[plus[order], minus[order], k] = chance[order].cumsum(0)[last].max(1)
    return p


def sign_flip(change: Change, scene: Scenes) -> float:
    """Return the exact two-sided p-value of no effect: the signs of the scenes' sums of changes are exchangeable."""
    sums = np.bincount(scene, change).astype(int) if len(change) else np.zeros(0, int)
    chance = np.ones(1)  # of each sum of the flipped values, from -reach to reach
    for value in np.abs(sums[sums != 0]):
        step = np.zeros(2 * value + 1)
        step[[0, -1]] = 0.5
        chance = np.convolve(chance, step)
    reach = len(chance) // 2
    return float(min(1.0, chance[np.abs(np.arange(-reach, reach + 1)) >= abs(sums.sum())].sum()))
