"""How sure we are: intervals, p-values and verdicts for effects measured on crossed seeds and scenes.

The unit of replication is the seed (a training set). All seeds share the test scenes, so an effect has two
sources of chance, another training set and other scenes, and both are resampled.
Nothing here knows what an effect is of.

Each sign-flip sees one source. Where both add alike to the variance of the mean, even the larger p-value is too
small (a true null falls below .05 about one time in nine; simulated in the tests), so read it with the interval and
the smallest effect of interest, as the verdict does, and not alone.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.stats import rankdata
from statsmodels.stats.multitest import multipletests

SMALLEST_EFFECT = 0.05  # smallest effect of interest, on the scale of P(valid)
LEVEL = 0.05  # family-wise level of the tests, and of each one-sided test of equivalence
EXACT_UNITS = 12  # up to so many units every pattern of signs is enumerated
VERDICTS = ("effect", "no effect", "inconclusive")


@dataclass(frozen=True)
class Estimates:
    """What crossed replications say about each cell's mean effect; every field has shape (cell,)."""

    effect: Float[Array, "cell"]  # mean over seeds and scenes
    ci_low: Float[Array, "cell"]  # 95 % interval
    ci_high: Float[Array, "cell"]
    ci90_low: Float[Array, "cell"]  # 90 % interval, for the test of equivalence
    ci90_high: Float[Array, "cell"]
    p_seeds: Float[Array, "cell"]  # sign-flip over seeds
    p_scenes: Float[Array, "cell"]  # sign-flip over scenes
    p: Float[Array, "cell"]  # the larger of the two
    q1: Float[Array, "cell"]  # quartiles of the seeds' mean effects
    q3: Float[Array, "cell"]


def estimate(
    effects: Float[Array, "cell seed scene"], rng: np.random.Generator, resamples: int, flips: int
) -> Estimates:
    """Mean effect, pigeonhole intervals and sign-flip p-values of each cell.

    All cells share the resamples and the random signs, so a cell's result does not depend on its neighbours.
    """
    if effects.ndim != 3 or 0 in effects.shape or not np.isfinite(effects).all():
        raise ValueError(
            f"effects of shape {effects.shape}, {np.isnan(effects).sum()} of them NaN: "
            "expected finite numbers (cell, seed, scene); check the models' predictions"
        )
    effects = np.asarray(effects, dtype=np.float64)
    means = pigeonhole(effects, rng, resamples)  # (cell, resample)
    low, high, low90, high90 = np.quantile(means, (0.025, 0.975, 0.05, 0.95), axis=-1)
    by_seed, by_scene = effects.mean(2), effects.mean(1)
    p_seeds, p_scenes = sign_flip(by_seed, rng, flips), sign_flip(by_scene, rng, flips)
    q1, q3 = np.quantile(by_seed, (0.25, 0.75), axis=1)
    p = np.maximum(p_seeds, p_scenes)
    return Estimates(by_seed.mean(1), low, high, low90, high90, p_seeds, p_scenes, p, q1, q3)


def pigeonhole(
    effects: Float[Array, "*cell seed scene"], rng: np.random.Generator, resamples: int
) -> Float[Array, "*cell resample"]:
    """Bootstrap means of crossed data: seeds and scenes each resampled whole (Owen 2007).

    A resample's mean is sum_sc w_s x_sc w_c, with w the share of the draws that each seed and each scene got.
    """
    seeds, scenes = effects.shape[-2:]
    w_seed = rng.multinomial(seeds, np.full(seeds, 1 / seeds), resamples) / seeds  # (resample, seed)
    w_scene = rng.multinomial(scenes, np.full(scenes, 1 / scenes), resamples) / scenes  # (resample, scene)
    return np.einsum("...rc,rc->...r", w_seed @ effects, w_scene)


def sign_flip(values: Float[Array, "*cell unit"], rng: np.random.Generator, flips: int) -> Float[Array, "*cell"]:
    """Two-sided p-value of a mean of zero, the units' signs being exchangeable under the null.

    Exact up to EXACT_UNITS units (with 10 the smallest p is 2/1024); beyond, `flips` random patterns of
    signs and the observed one.
    """
    units = values.shape[-1]
    if units <= EXACT_UNITS:
        signs = 1.0 - 2.0 * (np.arange(2**units)[:, None] >> np.arange(units) & 1)  # (pattern, unit)
    else:
        signs = rng.choice((-1.0, 1.0), (flips + 1, units))
        signs[0] = 1.0
    flipped = np.abs(values @ signs.T) / units  # (*cell, pattern)
    observed = np.abs(values.mean(-1, keepdims=True))
    extreme = flipped >= observed * (1 - 1e-9) - 1e-15  # a tie counts, whatever the rounding
    return np.asarray(extreme.mean(-1))


def paired_wilcoxon(a: Float[Array, "seed"], b: Float[Array, "seed"]) -> float:
    """Exact two-sided signed-rank p-value of paired values; equal pairs are dropped, ties share their rank.

    The null distribution is counted for the ranks at hand, so ties keep it exact; 1.0 if no pair differs.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 1 or not np.isfinite([a, b]).all():
        raise ValueError(f"pairs of shapes {a.shape} and {b.shape}: expected two finite vectors, a value a seed")
    difference = a - b
    difference = difference[~np.isclose(difference, 0.0, rtol=0, atol=1e-12)]
    ranks = np.rint(2 * rankdata(np.abs(difference).round(12))).astype(int)  # doubled, so that half ranks are whole
    ways = np.ones(1)  # ways[w]: sign patterns whose positive doubled ranks sum to w
    for rank in ranks:
        ways = np.pad(ways, (0, rank)) + np.pad(ways, (rank, 0))
    distance = np.abs(np.arange(len(ways)) - ranks.sum() / 2)
    return float(ways[distance >= distance[ranks[difference > 0].sum()]].sum() / ways.sum())


def holm(p: Float[Array, "test"]) -> Float[Array, "test"]:
    """Holm's adjusted p-values of one family of tests."""
    return np.asarray(multipletests(np.asarray(p, dtype=np.float64), method="holm")[1])


def verdict(effect: float, p_holm: float, ci90_low: float, ci90_high: float) -> str:
    """One of VERDICTS: significant and large; or equivalent to zero (two one-sided tests); or neither."""
    if p_holm < LEVEL and abs(effect) > SMALLEST_EFFECT:
        return "effect"
    if ci90_low > -SMALLEST_EFFECT and ci90_high < SMALLEST_EFFECT:
        return "no effect"
    return "inconclusive"


def true_verdict(effect: float) -> str:
    """The verdict a known true effect deserves: an effect only above the smallest of interest."""
    return "effect" if abs(effect) > SMALLEST_EFFECT else "no effect"


def quartiles(values: Float[Array, "seed"]) -> dict[str, float]:
    """Mean and first and third quartile, as the paper reports its seeds."""
    q1, q3 = np.quantile(values, (0.25, 0.75))
    return {"mean": float(np.mean(values)), "q1": float(q1), "q3": float(q3)}
