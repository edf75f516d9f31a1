"""How sure we are: intervals, p-values and verdicts for effects measured on crossed seeds and scenes.

The unit of replication is the seed (a training set). All seeds share the test scenes, so an effect has two
sources of chance, another training set and other scenes, and both count: an effect is the mean of a two-way layout
with random rows and columns. Nothing here knows what an effect is of. Stage selftest simulates how well this holds.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.special import stdtr, stdtrit  # Student's t; scipy.stats takes most of a second to import

SMALLEST_EFFECT = 0.05  # smallest effect of interest, on the scale of P(valid)
LEVEL = 0.05  # family-wise level of the tests, and of each one-sided test of equivalence
RARE = 0.5  # of the furthest that a family's scene lies from its cell's mean: how far scenes not met are expected
ENOUGH = 20  # scenes; two more beside fewer would be too large a part of the sample, and make intervals narrower
VERDICTS = ("effect", "negligible", "undecided")


@dataclass(frozen=True)
class Estimates:
    """What crossed replications say about each cell's mean effect; every field has shape (cell,)."""

    effect: Float[Array, " cell"]  # mean over seeds and scenes
    ci_low: Float[Array, " cell"]  # 95 % interval
    ci_high: Float[Array, " cell"]
    ci90_low: Float[Array, " cell"]  # 90 % interval, for the test of equivalence
    ci90_high: Float[Array, " cell"]
    p: Float[Array, " cell"]  # two-sided, of a mean of zero
    q1: Float[Array, " cell"]  # quartiles of the seeds' mean effects
    q3: Float[Array, " cell"]


def estimate(effects: Float[Array, "cell seed scene"]) -> Estimates:
    """Mean effect of each cell, and Student's intervals and p-values around it with `crossed_error`'s error."""
    _check(effects)
    effects = np.asarray(effects, dtype=np.float64)
    mean, by_seed = effects.mean((1, 2)), effects.mean(2)
    error, freedom = crossed_error(effects)
    wide, narrow = (stdtrit(freedom, q) * error for q in (0.975, 0.95))
    with np.errstate(divide="ignore", invalid="ignore"):
        p = np.where(error > 0, 2 * stdtr(freedom, -np.abs(mean) / error), np.where(mean == 0, 1.0, 0.0))
    q1, q3 = np.quantile(by_seed, (0.25, 0.75), axis=1)
    return Estimates(mean, mean - wide, mean + wide, mean - narrow, mean + narrow, p, q1, q3)


def add_pseudo_scenes(
    effects: Float[Array, "*family cell seed scene"],
) -> Float[Array, "*family cell seed more_scenes"]:
    """Each cell's effects and two scenes more, one as far above its mean as the other is below; no mean is moved.

    What a model does in a few scenes of one cell it may do in others more rarely than once in so many scenes. A cell
    whose scenes happen to agree would else be sure of its mean: so zeros and ones agree in a sample of a rare event,
    and Agresti and Coull (1998) add two of each. How far: RARE of the family's furthest. Fewer scenes than ENOUGH stay
    as they are.
    """
    _check(effects)
    if effects.shape[-1] < ENOUGH:
        return effects
    middle, away = effects.mean(-1, keepdims=True), rare(effects)[..., None, None, None]
    return np.concatenate([effects, middle - away, middle + away], axis=-1)


def rare(effects: Float[Array, "*family cell seed scene"]) -> Float[Array, "*family"]:
    """How far from its cell's mean a scene is expected that was not met; 0 if too few were."""
    if effects.shape[-1] < ENOUGH:
        return np.zeros(effects.shape[:-3])
    by_scene = effects.mean(-2)
    return np.asarray(RARE * np.abs(by_scene - by_scene.mean(-1, keepdims=True)).max((-2, -1)))


def _check(effects: Float[Array, "*family cell seed scene"]) -> None:
    """Raise ValueError unless these are numbers from which an error can be estimated."""
    if effects.ndim < 3 or 0 in effects.shape or effects.shape[-1] < 2 or not np.isfinite(effects).all():
        raise ValueError(
            f"effects of shape {effects.shape}, {np.isnan(effects).sum()} of them NaN: expected finite numbers "
            "(cell, seed, scene) of at least two scenes; check the models' predictions"
        )


def ratio(parts: Float[Array, "cell seed scene"], wholes: Float[Array, "cell seed scene"]) -> Estimates:
    """Sum of `parts` over sum of `wholes`: a rate of what not every seed and scene holds equally much of, or any.

    `linearised`, its error is a mean's; quartiles are of seeds likewise.
    """
    return estimate(linearised(parts, wholes))


def linearised(
    parts: Float[Array, "cell seed scene"], wholes: Float[Array, "cell seed scene"]
) -> Float[Array, "cell seed scene"]:
    """What has the rate, sum of `parts` over sum of `wholes`, for its mean and nearly its error (Cochran, 1977, Ch. 6).

    ValueError for a cell whose wholes sum to nothing.
    """
    total = wholes.sum((1, 2), keepdims=True)
    if not (total > 0).all():
        raise ValueError(f"{(total <= 0).sum()} of {len(total)} cells hold nothing to take a share of: leave them out")
    rate = parts.sum((1, 2), keepdims=True) / total
    return rate + (parts - rate * wholes) / wholes.mean((1, 2), keepdims=True)


def mean_squares(
    effects: Float[Array, "cell seed scene"],
) -> tuple[Float[Array, " cell"], Float[Array, " cell"], Float[Array, " cell"]]:
    """Mean squares of the two-way layout without replication: between seeds, between scenes, and of the rest.

    A single seed shows no chance of its own: its mean square, and that of the rest, are 0.
    """
    seeds, scenes = effects.shape[-2:]
    f_seed, f_scene, f_rest = _freedoms(seeds, scenes)
    mean = effects.mean((-2, -1), keepdims=True)
    by_seed, by_scene = effects.mean(-1, keepdims=True) - mean, effects.mean(-2, keepdims=True) - mean
    rest = effects - mean - by_seed - by_scene
    return (
        scenes * (by_seed**2).sum((-2, -1)) / f_seed,
        seeds * (by_scene**2).sum((-2, -1)) / f_scene,
        (rest**2).sum((-2, -1)) / f_rest,
    )


def _freedoms(seeds: int, scenes: int) -> tuple[int, int, int]:
    """Degrees of freedom of the three mean squares; 1 for one that is always 0."""
    return max(seeds - 1, 1), scenes - 1, max((seeds - 1) * (scenes - 1), 1)


def crossed_error(effects: Float[Array, "cell seed scene"]) -> tuple[Float[Array, " cell"], Float[Array, " cell"]]:
    """Standard error of each mean over random seeds crossed with random scenes, and its degrees of freedom.

    The variance of the mean is a sum of mean squares, MS_seed + MS_scene - MS_rest, over their number, in which no
    source of chance counts less than nothing; its degrees of freedom are Satterthwaite's (1946). Reader studies
    in radiology, readers crossed with patients, are analysed alike (Hillis, 2014).
    """
    seeds, scenes = effects.shape[-2:]
    by_seed, by_scene, rest = mean_squares(effects)
    more_seed, more_scene = by_seed > rest, by_scene > rest
    parts = (
        np.where(more_seed, by_seed, 0.0),
        np.where(more_scene, by_scene, 0.0),
        np.where(more_seed & more_scene, -rest, np.where(more_seed | more_scene, 0.0, rest)),
    )
    total = np.sum(parts, axis=0)
    spread = np.sum([part**2 / f for part, f in zip(parts, _freedoms(seeds, scenes), strict=True)], axis=0)
    freedom = np.where(spread > 0, total**2 / np.maximum(spread, np.finfo(float).tiny), 1.0)
    return np.sqrt(total / (seeds * scenes)), freedom


def paired_wilcoxon(a: Float[Array, " seed"], b: Float[Array, " seed"]) -> float:
    """Exact two-sided signed-rank p-value of paired values; equal pairs are dropped, ties share their rank.

    The null distribution is counted for the ranks at hand, so ties keep it exact; 1.0 if no pair differs.
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    if a.shape != b.shape or a.ndim != 1 or not np.isfinite([a, b]).all():
        raise ValueError(f"pairs of shapes {a.shape} and {b.shape}: expected two finite vectors, a value a seed")
    difference = a - b
    difference = difference[~np.isclose(difference, 0.0, rtol=0, atol=1e-12)]
    ranks = np.rint(2 * pd.Series(np.abs(difference).round(12)).rank()).to_numpy(
        int
    )  # doubled, so that half ranks are whole
    ways = np.ones(1)  # ways[w]: sign patterns whose positive doubled ranks sum to w
    for rank in ranks:
        ways = np.pad(ways, (0, rank)) + np.pad(ways, (rank, 0))
    distance = np.abs(np.arange(len(ways)) - ranks.sum() / 2)
    return float(ways[distance >= distance[ranks[difference > 0].sum()]].sum() / ways.sum())


def holm(p: Float[Array, "*family test"]) -> Float[Array, "*family test"]:
    """Holm's adjusted p-values (1979) of families of tests. (statsmodels' collects garbage at every call: 40 ms.)"""
    p = np.asarray(p, dtype=np.float64)
    order = p.argsort(-1)
    stepped = np.maximum.accumulate(np.take_along_axis(p, order, -1) * np.arange(p.shape[-1], 0, -1), -1)
    return np.take_along_axis(np.minimum(stepped, 1.0), order.argsort(-1), -1)


def verdict(effect: float, p_holm: float, ci90_low: float, ci90_high: float) -> str:
    """One of VERDICTS: significant and large; or equivalent to zero (two one-sided tests); or neither."""
    if p_holm < LEVEL and abs(effect) > SMALLEST_EFFECT:
        return "effect"
    if ci90_low > -SMALLEST_EFFECT and ci90_high < SMALLEST_EFFECT:
        return "negligible"
    return "undecided"


def true_verdict(effect: float) -> str:
    """The verdict a known true effect deserves: an effect only above the smallest of interest."""
    return "effect" if abs(effect) > SMALLEST_EFFECT else "negligible"


def quartiles(values: Float[Array, " seed"]) -> dict[str, float]:
    """Mean and first and third quartile, as the paper reports its seeds."""
    q1, q3 = np.quantile(values, (0.25, 0.75))
    return {"mean": float(np.mean(values)), "q1": float(q1), "q3": float(q3)}
