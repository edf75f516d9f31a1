"""Tests agree with third parties and with brute force, and verdicts follow the rules fixed in advance."""

from itertools import product

import numpy as np
import pytest
from numpy.random import default_rng as rng
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.weightstats import ttost_paired

from pipeline.stats.crossed import estimate
from pipeline.stats.tests import holm, paired_wilcoxon, verdict


@pytest.mark.parametrize("rounded", [False, True], ids=["distinct", "ties and zeros"])
def test_wilcoxon_is_the_exact_permutation_test(rounded: bool):
    for seed in range(20):
        differences = rng(seed).normal(0.3, 1, rng(seed).integers(2, 9))
        differences = differences.round(0) if rounded else differences
        nonzero = differences[differences != 0]
        ranks = np.array([np.mean(np.flatnonzero(np.sort(np.abs(nonzero)) == abs(d)) + 1) for d in nonzero])
        signs = np.array(list(product((1, -1), repeat=len(nonzero))))
        extreme = np.abs(signs @ ranks) >= abs(ranks @ np.sign(nonzero)) - 1e-9 if len(nonzero) else np.ones(1)
        assert paired_wilcoxon(differences, np.zeros_like(differences)) == pytest.approx(extreme.mean())


@pytest.mark.slow
def test_holm_agrees_with_statsmodels_family_by_family():
    families = rng(1).random((5, 12)) ** 3
    expected = [multipletests(p, method="holm")[1] for p in families]
    np.testing.assert_allclose(holm(families), expected, rtol=1e-12)
    assert holm(np.array([0.04])) == 0.04


def test_equivalence_by_the_90_percent_interval_is_two_one_sided_tests():
    for repeat in range(60):
        effects = rng(repeat).normal(0.035, 0.1, 150)
        e = estimate(effects[None, None])
        equivalent = verdict(np.nan, np.nan, e.ci90_low[0], e.ci90_high[0]) == "negligible"
        assert equivalent == (ttost_paired(effects, np.zeros(150), -0.05, 0.05)[0] < 0.05)


@pytest.mark.parametrize(
    ("ci95", "ci90", "expected"),
    [
        ((-0.15, -0.11), (-0.14, -0.12), "effect"),
        ((-0.15, -0.05), (-0.14, -0.06), "present"),  # the interval touches the bound
        ((0.01, 0.09), (0.02, 0.08), "present"),  # surely not 0, perhaps too small to matter
        ((-0.02, -0.01), (-0.02, -0.01), "negligible"),  # surely not 0, and too small to matter
        ((-0.30, 0.04), (-0.25, 0.01), "undecided"),
        ((-0.06, 0.05), (-0.05, 0.04), "undecided"),
        ((0.0, 0.0), (0.0, 0.0), "negligible"),  # exactly equal
        ((np.nan, np.nan), (np.nan, np.nan), "undecided"),  # too few pairs
        ((0.3, 0.3), (0.3, 0.3), "undecided"),  # no variance
    ],
)
def test_the_verdict_follows_the_rules_fixed_in_advance(ci95, ci90, expected):
    assert verdict(*ci95, *ci90) == expected
