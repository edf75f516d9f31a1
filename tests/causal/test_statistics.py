"""The statistics agree with third parties and with brute force, and keep their promises on simulated data."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import wilcoxon
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.weightstats import ttost_paired

from pipeline.causal.statistics import (
    Estimates,
    estimate,
    holm,
    paired_wilcoxon,
    pigeonhole,
    quartiles,
    sign_flip,
    true_verdict,
    verdict,
)

RESAMPLES, FLIPS = 500, 999


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


def test_the_exact_sign_flip_is_what_counting_every_pattern_gives():
    values = rng().normal(0.4, 1, 8)
    means = [abs(np.mean(values * signs)) for signs in product((1, -1), repeat=8)]
    assert sign_flip(values, rng(), FLIPS) == np.mean(np.array(means) >= abs(values.mean()) - 1e-12)


def test_ten_seeds_cannot_give_less_than_two_in_1024():
    assert sign_flip(np.ones(10), rng(), FLIPS) == 2 / 1024


def test_the_random_sign_flip_counts_the_observed_pattern_and_nears_the_exact_one():
    assert sign_flip(np.ones(100), rng(), FLIPS) == 1 / (FLIPS + 1)
    values = rng().normal(0.4, 1, 12)
    padded = np.concatenate([values, np.zeros(8)])  # zeros change no mean, but leave too many units to enumerate
    assert sign_flip(padded, rng(), 20_000) == pytest.approx(float(sign_flip(values, rng(), FLIPS)), abs=0.02)


@given(st.lists(st.floats(-1, 1), min_size=1, max_size=8), st.floats(0.1, 10))
def test_sign_flip_does_not_depend_on_units_or_on_the_effects_direction(values: list[float], scale: float):
    p = sign_flip(np.array(values), rng(), FLIPS)
    assert sign_flip(-np.array(values), rng(), FLIPS) == p
    assert 0 < p <= 1


def test_wilcoxon_is_scipys_exact_one():
    for seeds in (3, 10, 30):
        a, b = rng(seeds).normal(size=(2, seeds))
        assert paired_wilcoxon(a, b) == pytest.approx(wilcoxon(a, b, method="exact").pvalue)


def test_wilcoxon_stays_exact_with_ties():
    difference = np.array([0.1, 0.1, -0.1, 0.2, 0.2, 0.3, 0.0])
    ranks = np.array([2, 2, 2, 4.5, 4.5, 6])  # of the magnitudes; the pair without a difference is dropped
    observed = abs(np.sum(ranks * [1, 1, -1, 1, 1, 1]))
    sums = [abs(np.sum(ranks * signs)) for signs in product((1, -1), repeat=6)]
    assert paired_wilcoxon(difference, np.zeros(7)) == np.mean(np.array(sums) >= observed)


def test_wilcoxons_smallest_p_with_ten_seeds_is_a_512th():
    assert paired_wilcoxon(np.arange(1.0, 11), np.zeros(10)) == 2 / 1024  # .00195
    assert paired_wilcoxon(np.ones(10), np.ones(10)) == 1.0


def test_wilcoxon_refuses_what_is_no_number():
    with pytest.raises(ValueError, match="two finite vectors"):
        paired_wilcoxon(np.array([1.0, np.nan]), np.ones(2))


def test_holm_steps_down_from_the_smallest_p_as_statsmodels_does():
    for tests in (1, 12):
        p = rng(tests).random(tests) ** 3
        np.testing.assert_array_equal(holm(p), multipletests(p, method="holm")[1])
        order = np.argsort(p)
        stepped = np.minimum(np.maximum.accumulate(p[order] * np.arange(tests, 0, -1)), 1)
        np.testing.assert_allclose(holm(p)[order], stepped)


def test_equivalence_by_the_90_percent_interval_is_two_one_sided_tests():
    """With one seed the resampled interval of many scenes is nearly Student's, so the verdicts agree."""
    agree = []
    for repeat in range(60):
        effects = rng(repeat).normal(0.035, 0.1, 150)
        e = estimate(effects[None, None], rng(), RESAMPLES, FLIPS)
        equivalent = verdict(e.effect[0], 1.0, e.ci90_low[0], e.ci90_high[0]) == "no effect"
        agree.append(equivalent == (ttost_paired(effects, np.zeros(150), -0.05, 0.05)[0] < 0.05))
    assert np.mean(agree) >= 0.95


@pytest.mark.parametrize(
    ("effect", "p_holm", "low", "high", "expected"),
    [
        (-0.13, 0.02, -0.15, -0.11, "effect"),
        (-0.13, 0.05, -0.30, 0.04, "inconclusive"),  # large, not significant
        (0.05, 0.001, 0.045, 0.055, "inconclusive"),  # significant, not larger than what matters
        (-0.017, 0.001, -0.02, -0.014, "no effect"),  # significant and too small to matter
        (0.0, 1.0, -0.05, 0.04, "inconclusive"),  # the interval touches the bound
        (0.0, 1.0, 0.0, 0.0, "no effect"),
    ],
)
def test_the_verdict_follows_the_rules_fixed_in_advance(effect, p_holm, low, high, expected):
    assert verdict(effect, p_holm, low, high) == expected


def test_the_truth_has_an_effect_only_above_the_smallest_of_interest():
    assert [true_verdict(e) for e in (-0.051, 0.05, 0.0)] == ["effect", "no effect", "no effect"]


def test_a_model_that_never_changes_its_mind_has_no_effect_for_certain():
    e = estimate(np.zeros((1, 10, 100)), rng(), RESAMPLES, FLIPS)
    assert (e.effect[0], e.ci_low[0], e.ci_high[0], e.p[0]) == (0, 0, 0, 1)
    assert verdict(e.effect[0], e.p[0], e.ci90_low[0], e.ci90_high[0]) == "no effect"


def test_a_cell_does_not_depend_on_its_neighbours():
    effects = crossed(5, 0.03, 0.1)
    together, alone = (estimate(x, rng(), RESAMPLES, FLIPS) for x in (effects, effects[3:4]))
    np.testing.assert_allclose([together.ci_low[3], together.p[3]], [alone.ci_low[0], alone.p[0]])


def test_effects_that_are_no_numbers_are_refused():
    with pytest.raises(ValueError, match="1 of them NaN"):
        estimate(np.array([[[0.1, np.nan]]]), rng(), RESAMPLES, FLIPS)


def test_quartiles_are_the_papers_summary():
    assert quartiles(np.array([0.0, 1.0, 2.0, 3.0, 4.0])) == {"mean": 2.0, "q1": 1.0, "q3": 3.0}


def test_the_pigeonhole_sees_the_chance_of_seeds_and_of_scenes():
    """Its variance is at least that of the crossed mean: by_seed^2 / 10 + by_scene^2 / 100 (+ rest^2 / 1000)."""
    for by_seed, by_scene in ((0.1, 0.0), (0.0, 0.3), (0.1, 0.3)):
        effects = crossed(200, by_seed, by_scene, rest=0.01)
        resampled = pigeonhole(effects, rng(), 400).std(-1) ** 2
        expected = by_seed**2 / 10 + by_scene**2 / 100 + 0.01**2 / 1000
        assert 0.8 < resampled.mean() / expected < 1.1  # nine tenths of a seed's chance is seen with ten seeds


@pytest.mark.parametrize(("by_seed", "by_scene"), [(0.03, 0.0), (0.0, 0.1), (0.03, 0.1), (0.01, 0.1)])
def test_95_percent_intervals_cover_the_effect_about_as_often(by_seed: float, by_scene: float):
    e = estimate(crossed(400, by_seed, by_scene) + 0.1, rng(), RESAMPLES, FLIPS)
    assert 0.9 <= covers(e, 0.1) <= 0.985  # ten seeds: a little less where their chance rules


@pytest.mark.parametrize(("by_seed", "by_scene"), [(0.03, 0.0), (0.0, 0.1), (0.01, 0.1), (0.0, 0.0)])
def test_where_one_source_of_chance_rules_the_p_value_keeps_its_level(by_seed: float, by_scene: float):
    e = estimate(crossed(400, by_seed, by_scene), rng(), 1, FLIPS)
    assert (e.p < 0.05).mean() <= 0.075  # .05 and twice the simulation's own error


def test_either_sign_flip_alone_would_cry_wolf_where_the_other_source_rules():
    assert (estimate(crossed(400, 0.0, 0.3), rng(), 1, FLIPS).p_seeds < 0.05).mean() > 0.3
    assert (estimate(crossed(400, 0.1, 0.0), rng(), 1, FLIPS).p_scenes < 0.05).mean() > 0.3


def test_where_both_sources_matter_alike_the_p_value_alone_is_too_small():
    e = estimate(crossed(1000, 0.03, 0.1), rng(), 1, FLIPS)
    assert 0.09 < (e.p < 0.05).mean() < 0.15


@pytest.mark.parametrize(("by_seed", "by_scene"), [(0.03, 0.1), (0.03, 0.0), (0.0, 0.3)])
def test_a_family_of_twelve_null_cells_rarely_holds_an_effect(by_seed: float, by_scene: float):
    """The verdict's error, also where both sources matter alike and the p-value alone is too small."""
    e = estimate(crossed(600, by_seed, by_scene), rng(), RESAMPLES, FLIPS)
    first_step = 12 * e.p  # Holm's family rejects something if and only if this does
    found = [verdict(*cell) for cell in zip(e.effect, first_step, e.ci90_low, e.ci90_high, strict=True)]
    families = (np.array(found) == "effect").reshape(-1, 12).any(1)
    assert families.mean() <= 0.05 + 0.03


def test_no_effect_is_rarely_said_of_an_effect_at_the_bound():
    e = estimate(crossed(400, 0.03, 0.05) + 0.05, rng(), RESAMPLES, FLIPS)
    said = [verdict(*c) for c in zip(e.effect, np.ones(400), e.ci90_low, e.ci90_high, strict=True)]
    assert (np.array(said) == "no effect").mean() <= 0.085
