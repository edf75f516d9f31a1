"""The statistics agree with third parties and with brute force, and keep their promises on simulated data."""

import numpy as np
import pandas as pd
import pytest
from scipy.stats import ttest_1samp
from statsmodels.formula.api import ols
from statsmodels.stats.anova import anova_lm

from pipeline.stats.crossed import (
    Estimates,
    crossed_error,
    estimate,
    mean_squares,
    ratio,
)
from pipeline.stats.tests import verdict


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def crossed(repeats: int, by_seed: float, by_scene: float, rest: float = 0.1) -> np.ndarray:
    """Null effects (repeat, 10 seeds, 100 scenes): normal chance of each seed, of each scene, and of each pair."""
    g = rng(7)
    return (
        by_seed * g.normal(size=(repeats, 10, 1))
        + by_scene * g.normal(size=(repeats, 1, 100))
        + rest * g.normal(size=(repeats, 10, 100))
    )


def covers(e: Estimates, effect: float) -> float:
    return float(((e.ci_low <= effect) & (effect <= e.ci_high)).mean())


def test_a_model_that_never_changes_has_certainly_no_effect():
    e = estimate(np.zeros((1, 10, 100)))
    assert (e.effect[0], e.ci_low[0], e.ci_high[0], e.p[0]) == (0, 0, 0, 1)
    assert verdict(e.effect[0], e.p[0], e.ci90_low[0], e.ci90_high[0]) == "negligible"


def with_mean_squares(by_seed: float, by_scene: float, rest: float, seeds: int = 4, scenes: int = 7) -> np.ndarray:
    """Effects (1, seed, scene) whose two-way layout has these mean squares to the bit's width."""
    g = rng(3)
    a, b, c = g.normal(size=(seeds, 1)), g.normal(size=(1, scenes)), g.normal(size=(seeds, scenes))
    a, b, c = a - a.mean(), b - b.mean(), c - c.mean(0) - c.mean(1, keepdims=True) + c.mean()
    freedoms = seeds - 1, scenes - 1, (seeds - 1) * (scenes - 1)
    parts = (np.broadcast_to(part, (seeds, scenes)) for part in (a, b, c))
    scaled = [
        part * np.sqrt(wanted * freedom / (part**2).sum())
        for part, wanted, freedom in zip(parts, (by_seed, by_scene, rest), freedoms, strict=True)
    ]
    return np.sum(scaled, axis=0)[None]


@pytest.mark.parametrize(
    ("squares", "total", "spread"),
    [
        ((5.0, 3.0, 1.0), 5 + 3 - 1, 5**2 / 3 + 3**2 / 6 + 1 / 18),  # both sources count
        ((5.0, 0.5, 1.0), 5.0, 5**2 / 3),  # scenes less than chance would: the seeds alone
        ((0.5, 3.0, 1.0), 3.0, 3**2 / 6),  # seeds less
        ((0.5, 0.7, 1.0), 1.0, 1 / 18),  # neither: every pair a replication
    ],
)
def test_the_error_behind_every_interval_is_that_of_the_mean_squares(squares, total, spread):
    """Variance of the mean (MS_seed + MS_scene - MS_rest) / (seeds scenes), freedom by Satterthwaite (1946)."""
    effects = with_mean_squares(*squares)
    np.testing.assert_allclose(np.ravel(mean_squares(effects)), squares)
    error, freedom = crossed_error(effects)
    assert error[0] ** 2 == pytest.approx(total / (4 * 7))
    assert freedom[0] == pytest.approx(total**2 / spread)


def test_effects_with_nan_and_a_ratio_over_zero_are_refused():
    with pytest.raises(ValueError, match="1 of them NaN"):
        estimate(np.array([[[0.1, np.nan]]]))
    with pytest.raises(ValueError, match="1 of 2 denominators sum to 0"):
        ratio(np.zeros((2, 3, 4)), np.stack([np.ones((3, 4)), np.zeros((3, 4))]))


REGIMES = [(0.03, 0.0), (0.0, 0.1), (0.03, 0.1), (0.01, 0.1)]  # standard deviations of seeds and of scenes


@pytest.mark.parametrize(("by_seed", "by_scene"), REGIMES)
def test_the_p_value_keeps_its_level_whether_seeds_or_scenes_vary_more(by_seed: float, by_scene: float):
    assert (estimate(crossed(2000, by_seed, by_scene)).p < 0.05).mean() <= 0.065  # .05, three of its own errors above


@pytest.mark.parametrize(("by_seed", "by_scene"), REGIMES)
@pytest.mark.parametrize("skewed", [False, True])
def test_95_percent_intervals_cover_the_effect(by_seed: float, by_scene: float, skewed: bool):
    assert 0.93 <= covers(estimate(crossed(1200, by_seed, by_scene) + 0.1, skewed), 0.1) <= 0.97


@pytest.mark.parametrize("skewed", [False, True])
def test_p_is_005_where_the_interval_ends_at_zero(skewed: bool):
    effects = np.exp(crossed(6, 0.03, 1.0))  # scenes are skewed
    e = estimate(effects, skewed)
    for end in (e.ci_low, e.ci_high):
        np.testing.assert_allclose(estimate(effects - end[:, None, None], skewed).p, 0.05, rtol=1e-6)


def test_the_correction_for_skewness_widens_the_side_of_the_long_tail_and_knows_no_other_side():
    effects = np.exp(crossed(6, 0.0, 1.0))
    plain, corrected, mirrored = estimate(effects), estimate(effects, True), estimate(-effects, True)
    assert (corrected.ci_high > plain.ci_high).all() and (corrected.ci_low > plain.ci_low).all()
    np.testing.assert_allclose([mirrored.ci_low, mirrored.ci_high], [-corrected.ci_high, -corrected.ci_low])
    symmetric = np.concatenate([effects, 2 * effects.mean((1, 2), keepdims=True) - effects], -1)
    np.testing.assert_allclose(estimate(symmetric, True).ci_low, estimate(symmetric).ci_low)


@pytest.mark.parametrize("scenes", [0, 1])
def test_fewer_than_two_scenes_are_refused(scenes: int):
    with pytest.raises(ValueError, match="at least two scenes"):
        estimate(np.zeros((3, 4, scenes)))


def test_the_mean_squares_are_those_of_an_analysis_of_variance():
    effects = crossed(1, 0.03, 0.1)[0, :4, :5]
    seed, scene = (i.ravel() for i in np.indices(effects.shape))
    table = pd.DataFrame({"effect": effects.ravel(), "seed": seed, "scene": scene})
    anova = anova_lm(ols("effect ~ C(seed) + C(scene)", table).fit())
    squares = [m[0] for m in mean_squares(effects[None])]
    np.testing.assert_allclose(squares, anova["sum_sq"] / anova["df"])


@pytest.mark.parametrize(("shape", "count"), [((1, 1, -1), 60), ((1, -1, 1), 10)], ids=["one seed", "equal scenes"])
def test_where_one_source_varies_it_is_students_test_over_that_one(shape: tuple, count: int):
    values = rng(3).normal(0.02, 0.1, count)
    e = estimate(np.repeat(values.reshape(shape), 1 if shape[-1] == -1 else 100, axis=2))
    expected = ttest_1samp(values, 0)
    assert e.p[0] == pytest.approx(expected.pvalue)
    np.testing.assert_allclose([e.ci_low[0], e.ci_high[0]], expected.confidence_interval())


def test_a_ratios_interval_covers_it_where_seeds_and_scenes_hold_unequally_many():
    g, repeats = rng(8), 1500
    scene, seed = g.normal(0, 1, (repeats, 1, 60)), g.normal(0, 0.3, (repeats, 10, 1))
    wholes = g.poisson(np.exp(0.5 + 0.7 * scene), (repeats, 10, 60)).astype(float)  # many cells hold none
    chance = 1 / (1 + np.exp(-(scene + seed + g.normal(0, 1, (repeats, 1, 60)))))
    parts = g.binomial(wholes.astype(int), np.broadcast_to(chance, wholes.shape)).astype(float)
    truth = parts.sum() / wholes.sum()
    assert 0.92 <= covers(ratio(parts, wholes), truth) <= 0.97
