"""Conformal selection keeps its promise where demonstrations and paths are exchangeable, and only there."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from statsmodels.stats.multitest import multipletests

from pipeline.stats.conformal import accept, p_values

WORLDS, DEMONSTRATIONS, PATHS, LEVEL = 1000, 100, 40, 0.1


def draw(rng: np.random.Generator, count: int, apart: float = 3.0):
    """Return scores and labels of `count` paths; invalid ones score `apart` lower."""
    valid = rng.random(count) < 0.5
    return rng.standard_normal(count) - apart * ~valid, valid


def false_discovery_rate(
    level: float = LEVEL, demonstrations: float = 3.0, paths: float = 3.0, lowest: float = -np.inf
) -> tuple[float, float]:
    """Return the mean share of invalid accepted paths over worlds, and its standard error.

    demonstrations, paths: how far apart the scores of valid and invalid ones are. lowest: where scores are cut off.
    """
    rng, shares = np.random.default_rng(5), []
    for _ in range(WORLDS):
        held_out, labels = draw(rng, DEMONSTRATIONS, demonstrations)
        scores, valid = draw(rng, PATHS, paths)
        accepted = accept(p_values(np.maximum(held_out, lowest), labels, np.maximum(scores, lowest)), level)
        shares.append((accepted & ~valid).sum() / max(accepted.sum(), 1))
    return float(np.mean(shares)), float(np.std(shares) / WORLDS**0.5)


@pytest.mark.parametrize(("level", "lowest"), [(0.05, -np.inf), (0.3, -np.inf), (0.1, -1.5)])
def test_the_false_discovery_rate_is_at_most_the_level_among_exchangeable_paths(level, lowest):
    rate, error = false_discovery_rate(level, lowest=lowest)
    assert rate < level + 2 * error
    assert rate > 0.6 * level or lowest > -np.inf  # and the promise is not an idle one


@pytest.mark.parametrize(
    ("demonstrations", "paths"), [(3.0, 1.5), (8.0, 3.0)], ids=["new kinds of paths", "scores of fitted demonstrations"]
)
def test_the_promise_breaks_where_demonstrations_score_better_than_paths(demonstrations, paths):
    rate, error = false_discovery_rate(demonstrations=demonstrations, paths=paths)
    assert rate > LEVEL + 10 * error


@settings(deadline=None)
@given(st.lists(st.floats(0.0001, 1.0), min_size=1, max_size=40), st.floats(0.001, 0.999))
def test_scipy_and_statsmodels_accept_the_same_paths(p: list[float], level: float):
    theirs = multipletests(p, alpha=level, method="fdr_bh")[1]
    near = np.isclose(theirs, level, rtol=1e-9)
    assert np.array_equal(accept(np.array(p), level)[~near], (theirs <= level)[~near])
