"""Means, intervals and p-values of effects measured on seeds crossed with scenes.

The unit of replication is the seed (a training set). All seeds share the test scenes, so an effect has two sources of
chance: training sets and scenes. It is modelled as the mean of a two-way layout with random rows and columns.
tests/stats/test_calibration.py checks levels and coverage by simulation.

Items are a further source of chance. A model's error on an item, such as an outline detected too wide, recurs in every
scene with that item. If a result is to hold for other items of the symbol, scenes that share an item vary together
(`items` of `estimate`), or each item counts once: cluster means are the observations (`by_item`; Donner, Klar, 2000).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.stats import t as student

Effects = Float[Array, "question seed scene"]
Means = Float[Array, " question"]
Held = Int[Array, "*question scene item"]  # the items of each scene: 1, 2, ... by their kind, 0 for one that it lacks
Items = Held | None  # those that are chance, as they are unseen; None: none


def items_held(item: Int[Array, "*version scene slot"], symbol: Int[Array, "*version scene slot"]) -> Held:
    """Return the items that each scene holds, by kind; symbol: -1 in an empty slot."""
    which = np.unique(item[symbol >= 0])
    return ((item[..., None] == which) * (1 + symbol[..., None])).max(-2)


@dataclass(frozen=True)
class Estimates:
    """Estimates of each question's mean effect; all fields have shape (question,)."""

    effect: Means  # mean over seeds and scenes
    ci_low: Means  # 95 % interval
    ci_high: Means
    ci90_low: Means  # 90 % interval, for the equivalence test
    ci90_high: Means
    p: Means  # two-sided p-value of zero mean
    q1: Means  # quartiles over seeds of the mean effect
    q3: Means

    def row(self, *names: str, share: bool = False) -> dict[str, float]:
        """Return the first question's mean and 95 % interval under three names; a share's interval is within [0, 1]."""
        ends = [float(x[0].clip(0, 1) if share else x[0]) for x in (self.ci_low, self.ci_high)]
        return dict(zip(names or ("mean", "ci_low", "ci_high"), (float(self.effect[0]), *ends), strict=True))


def estimate(effects: Effects, skewed: bool = False, items: Items = None) -> Estimates:
    """Return each question's mean effect with Student's intervals and p-value, from the error of `crossed_error`.

    If all effects are equal, the interval is that number.

    skewed: correct them for the skewness of the scenes' means by Hall's transformation (1992). If few scenes decide, a
    sample with too few of them has a mean and an error that are both too small. The correction needs scenes enough to
    estimate a third moment. ValueError unless the effects are finite and of at least two scenes.
    """
    if effects.shape[-1] < 2 or not np.isfinite(effects).all():
        nan = np.isnan(effects).sum()
        raise ValueError(f"effects of {effects.shape[-1]} scenes, {nan} of them NaN: expected two scenes, no NaN")
    effects = np.asarray(effects, dtype=np.float64)
    mean, by_scene = effects.mean((1, 2)), effects.mean(1)
    error, freedom = crossed_error(effects, items)
    some = error > 1e-12 * np.abs(mean)  # less is rounding: effects that do not vary have the p of an exact sign test
    error = np.where(some, error, 0.0)
    third_moment = ((by_scene - mean[:, None]) ** 3).mean(-1) / by_scene.shape[-1] ** 2  # of the mean
    skewness = np.divide(third_moment, error**3, out=np.zeros_like(mean), where=some & skewed)
    t = np.divide(mean, error, out=np.zeros_like(mean), where=some)
    t = t + skewness * t**2 / 3 + skewness**2 * t**3 / 27 + skewness / 6
    p = np.where(some, 2 * student.sf(np.abs(t), freedom), np.where(mean == 0, 1.0, 0.5 ** (effects.shape[-1] - 1)))
    quantiles = student.ppf([[0.975], [0.025], [0.95], [0.05]], freedom)
    safe = np.where(np.abs(skewness) > 1e-6, skewness, 1.0)  # the same transformation, inverted
    shifts = np.where(safe == skewness, 3 / safe * (np.cbrt(1 + safe * (quantiles - safe / 6)) - 1), quantiles)
    low95, high95, low90, high90 = mean - error * shifts
    q1, q3 = np.quantile(effects.mean(2), (0.25, 0.75), axis=1)
    return Estimates(mean, low95, high95, low90, high90, p, q1, q3)


def ratio(numerators: Effects, denominators: Effects, items: Items = None) -> Estimates:
    """Return estimates of sum(numerators) / sum(denominators), with the standard error of `linearised`.

    Suitable for rates of events that occur unequally often across seeds and scenes, or not at all in some.
    """
    return estimate(linearised(numerators, denominators), items=items)


def linearised(numerators: Effects, denominators: Effects) -> Effects:
    """Return values with the ratio of sums as mean and nearly the ratio's standard error (Cochran, 1977, Chapter 6)."""
    rate = numerators.sum((1, 2), keepdims=True) / denominators.sum((1, 2), keepdims=True)
    return rate + (numerators - rate * denominators) / denominators.mean((1, 2), keepdims=True)


def mean_squares(effects: Effects) -> tuple[Means, Means, Means]:
    """Return the mean squares of seeds, scenes and residuals in a two-way layout without replication.

    With a single seed, the mean squares of seeds and residuals are 0.
    """
    seeds, scenes = effects.shape[-2:]
    f_seed, f_scene, f_rest = _degrees_of_freedom(seeds, scenes)
    mean = effects.mean((-2, -1), keepdims=True)
    by_seed, by_scene = effects.mean(-1, keepdims=True) - mean, effects.mean(-2, keepdims=True) - mean
    rest = effects - mean - by_seed - by_scene
    of_seeds, of_scenes, of_rest = ((part**2).sum((-2, -1)) for part in (by_seed, by_scene, rest))
    return scenes * of_seeds / f_seed, seeds * of_scenes / f_scene, of_rest / f_rest


def crossed_error(effects: Effects, items: Items = None) -> tuple[Means, Means]:
    """Return each mean's standard error over random seeds crossed with random scenes, and its degrees of freedom.

    The variance of the mean is (MS_seed + MS_scene - MS_rest) / (seeds * scenes); negative variance components are 0.
    With `items`, MS_scene is multiplied by `item_inflation`, and has as many degrees of freedom as items less kinds.
    Degrees of freedom are Satterthwaite's (1946). Radiology uses the same analysis for readers crossed with patients
    (Hillis, 2014).
    """
    seeds, scenes = effects.shape[-2:]
    by_seed, by_scene, rest = mean_squares(effects)
    freedoms = list(_degrees_of_freedom(seeds, scenes))
    if items is not None:
        by_scene = by_scene * item_inflation(effects.mean(-2), items)
        kinds = np.sort(items.max(-2), -1)
        freedom = (kinds > 0).sum(-1) - (np.diff(kinds, axis=-1, prepend=0) > 0).sum(-1)
        freedoms[1] = np.clip(freedom, 1, scenes - 1)
    seeds_vary, scenes_vary = by_seed > rest, by_scene > rest
    of_rest = np.where(seeds_vary & scenes_vary, -rest, np.where(seeds_vary | scenes_vary, 0.0, rest))
    terms = np.where(seeds_vary, by_seed, 0.0), np.where(scenes_vary, by_scene, 0.0), of_rest
    total = np.sum(terms, axis=0)
    spread = np.sum([term**2 / f for term, f in zip(terms, freedoms, strict=True)], axis=0)
    freedom = np.where(spread > 0, total**2 / np.maximum(spread, np.finfo(float).tiny), 1.0)
    return np.sqrt(total / (seeds * scenes)), freedom


def item_inflation(by_scene: Float[Array, "question scene"], items: Held) -> Means:
    """Return the factor, at least 1, by which each mean's variance grows since scenes that share an item vary together.

    The covariances are the products of deviations over all pairs of scenes that share an item (Aronow, Samii and
    Assenova, 2015). Kinds are no chance: deviations are from a fit by the number of items of each kind. `scale` makes
    the sum unbiased if items alone differ.
    """
    held, deviations = (items > 0).astype(float), by_scene - by_scene.mean(-1, keepdims=True)
    shared = (held @ held.swapaxes(-1, -2) > 0).astype(float)
    counts = np.stack([np.ones(items.shape[:-1]), *((items == k).sum(-1) for k in range(1, items.max() + 1))], -1)
    fit = counts @ np.linalg.pinv(counts)
    apart, rest = held - fit @ held, deviations[..., None] - fit @ deviations[..., None]
    expected = ((shared @ apart) * apart).sum((-1, -2))
    scale = np.where(expected > 1e-9, (held.sum(-2) ** 2).sum(-1) / np.maximum(expected, 1e-9), 1.0)
    together = scale * ((shared @ rest) * rest).sum((-1, -2)) - (rest**2).sum((-1, -2))
    squares = (deviations**2).sum(-1)
    return 1 + np.maximum(np.divide(together, squares, out=np.zeros_like(squares), where=squares > 0), 0)


def quartiles(values: Float[Array, " seed"]) -> dict[str, float]:
    """Return mean, first and third quartile over seeds, as the paper reports them."""
    q1, q3 = np.quantile(values, (0.25, 0.75))
    return {"mean": float(np.mean(values)), "q1": float(q1), "q3": float(q3)}


def _degrees_of_freedom(seeds: int, scenes: int) -> tuple[int, int, int]:
    """Return the degrees of freedom of the three mean squares; 1 for one that is always 0."""
    return max(seeds - 1, 1), scenes - 1, max((seeds - 1) * (scenes - 1), 1)


def by_item(values: Float[Array, "seed scene dose"], item: Int[Array, " scene"]) -> Float[Array, "seed item dose"]:
    """Return the mean over the scenes of each added item, ignoring NaN; NaN if no value remains."""
    members = np.stack([item == i for i in np.unique(item)])[:, :, None] & ~np.isnan(values[0])  # (item, scene, dose)
    sums = np.einsum("sxd,ixd->sid", np.nan_to_num(values), members.astype(float))
    return np.where(members.any(1), sums / np.maximum(members.sum(1), 1), np.nan)


def inflate_item_variance(values: Float[Array, "seed item"], n_training: int) -> Float[Array, "seed item"]:
    """Return the values with deviations between items inflated for the variance of the `n_training` items of all seeds.

    Added and training items are drawn from the items of the symbol. We assume that a model's error on an item depends
    on its difference from the training items. The variance over items of a mean over n items is then
    1 / n + 1 / n_training of a single item's. The mean is unchanged.
    """
    mean, n = values.mean(0), values.shape[1]
    return values + (np.sqrt(1 + n / n_training) - 1) * (mean - mean.mean())
