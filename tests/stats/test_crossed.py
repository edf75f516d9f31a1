"""The statistics agree with third parties and with brute force, and keep their promises on simulated data."""

import numpy as np
import pandas as pd
import pytest
from numpy.random import default_rng as rng
from scipy.stats import binomtest, ttest_1samp
from statsmodels.formula.api import ols
from statsmodels.stats.anova import anova_lm

from pipeline.stats.crossed import Estimates, by_item, crossed_error, estimate, mean_squares, ratio


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


@pytest.mark.parametrize("constant", [(), (0,), (1,), (0, 1)], ids=["both", "scenes alone", "seeds alone", "neither"])
def test_the_error_behind_every_interval_is_that_of_the_mean_squares(constant: tuple[int, ...]):
    """Variance of the mean (MS_seed + MS_scene - MS_rest) / (seeds scenes), freedom by Satterthwaite (1946).

    A source whose means do not differ counts nothing; without either, every pair is a replication.
    """
    g = rng(3)
    effects = 2 * g.normal(size=(1, 4, 1)) + 2 * g.normal(size=(1, 1, 7)) + g.normal(size=(1, 4, 7))
    for source in constant:
        effects = effects - effects.mean(2 - source, keepdims=True)
    by_seed, by_scene, rest = (float(square[0]) for square in mean_squares(effects))
    counted = {(): [(by_seed, 3), (by_scene, 6), (-rest, 18)], (0,): [(by_scene, 6)], (1,): [(by_seed, 3)]}
    terms = counted.get(constant, [(rest, 18)])
    total = sum(square for square, _ in terms)
    error, freedom = crossed_error(effects)
    assert error[0] ** 2 == pytest.approx(total / (4 * 7))
    assert freedom[0] == pytest.approx(total**2 / sum(square**2 / f for square, f in terms))


@pytest.mark.parametrize("shape", [(1, 1, 2), (1, 1, 30), (1, 3, 30)])
def test_effects_that_do_not_vary_have_the_p_of_a_sign_test(shape: tuple[int, ...]):
    expected = binomtest(shape[2], shape[2]).pvalue
    for effects in (np.full(shape, 0.3), np.full(shape, 0.1) + np.arange(shape[1])[:, None] * 1e-17):
        assert estimate(effects).p == estimate(effects, skewed=True).p == pytest.approx(expected)
    assert estimate(np.zeros(shape)).p == 1


REGIMES = [(0.03, 0.0), (0.0, 0.1), (0.03, 0.1), (0.01, 0.1)]  # standard deviations of seeds and of scenes


@pytest.mark.parametrize(("by_seed", "by_scene"), REGIMES)
@pytest.mark.parametrize("skewed", [False, True])
def test_95_percent_intervals_cover_the_effect(by_seed: float, by_scene: float, skewed: bool):
    assert 0.93 <= covers(estimate(crossed(1200, by_seed, by_scene) + 0.1, skewed), 0.1) <= 0.97


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


def test_an_item_counts_once_whatever_the_number_of_its_scenes():
    drop = np.array([[[1, 2.0], [3, np.nan], [5, np.nan], [7, np.nan]]])  # of one seed, in four scenes
    np.testing.assert_array_equal(by_item(drop, np.array([4, 4, 2, 2])), [[[6, np.nan], [2, 2]]])  # item 2, item 4


@pytest.mark.parametrize("on_table", [True, False], ids=["two or three items a scene", "an added one"])
def test_intervals_that_take_items_as_chance_cover_where_others_do_not(on_table: bool):
    rng, covered = np.random.default_rng(0), []
    kind = np.repeat([1, 2, 3, 4], 6) if on_table else np.ones(6, int)
    for _ in range(200):
        held = rng.random((100, len(kind))).argsort(1) < (rng.integers(2, 4, (100, 1)) if on_table else 1)
        of_items = rng.normal(0, 0.1, len(kind)) + 0.1 * (kind - kind.mean())
        chance = rng.normal(0, 0.03, (10, 1)) + rng.normal(0, 0.1, (1, 100)) + rng.normal(0, 0.1, (10, 100))
        effects = (held @ of_items + chance)[None]
        intervals = estimate(effects, items=held * kind), estimate(effects)
        covered.append([e.ci_low[0] <= 0 <= e.ci_high[0] for e in intervals])
    items, scenes = np.mean(covered, axis=0)
    assert 0.9 <= items <= 0.99 and scenes < 0.8


def test_equal_scenes_have_no_error_whatever_items_they_share():
    items = np.eye(4, dtype=int).repeat(3, axis=0)
    e = estimate(np.full((1, 6, 12), 0.25), items=items)
    assert e.ci_low == e.ci_high == 0.25
