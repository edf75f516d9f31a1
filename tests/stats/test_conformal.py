"""Conformal selection keeps its promise where demonstrations and paths are exchangeable, and only there."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit
from statsmodels.stats.multitest import multipletests

from pipeline.stats.conformal import (
    Calibration,
    accept,
    accept_knowing,
    by_scene,
    fewest_demonstrations,
    fewest_without_error,
    p_values,
    score,
)  # fmt: skip

WORLDS, DEMONSTRATIONS, PATHS, LEVEL = 1000, 100, 40, 0.1


def draw(rng: np.random.Generator, count: int, apart: float = 3.0, grain: float = 0.0):
    """Labels of `count` paths, and scores in steps of `grain`: invalid ones are `apart` below valid ones."""
    valid = rng.random(count) < 0.5
    scores = rng.standard_normal(count) - apart * ~valid
    return np.round(scores / grain) * grain if grain else scores, valid


def false_share(accepted: np.ndarray, valid: np.ndarray) -> float:
    return float((accepted & ~valid).sum() / max(accepted.sum(), 1))


def false_discovery_rate(
    level: float = LEVEL, grain: float = 0.0, demonstrations: float = 3.0, paths: float = 3.0, lowest: float = -np.inf
) -> tuple[float, float]:
    """Mean share of invalid accepted paths over worlds, and its standard error.

    demonstrations, paths: how far apart the scores of valid and invalid ones are. lowest: where scores are cut off.
    """
    rng, shares = np.random.default_rng(5), []
    for _ in range(WORLDS):
        held_out, labels = draw(rng, DEMONSTRATIONS, demonstrations, grain)
        scores, valid = draw(rng, PATHS, paths, grain)
        part = Calibration(np.maximum(held_out, lowest), labels, np.maximum(scores, lowest))
        shares.append(false_share(accept(p_values([part]), level), valid))
    return float(np.mean(shares)), float(np.std(shares) / WORLDS**0.5)


@pytest.mark.parametrize("level", [0.05, 0.1, 0.3])
@pytest.mark.parametrize(("grain", "lowest"), [(0.0, -np.inf), (0.5, -np.inf), (0.0, -1.5)])
def test_among_exchangeable_paths_the_false_discovery_rate_is_the_level_at_most(level, grain, lowest):
    rate, error = false_discovery_rate(level, grain, lowest=lowest)
    assert rate < level + 2 * error
    if not grain and lowest == -np.inf:
        assert rate > 0.6 * level  # and the promise is no idle one


@pytest.mark.parametrize(
    ("demonstrations", "paths"), [(3.0, 1.5), (8.0, 3.0)], ids=["new kinds of paths", "scores of fitted demonstrations"]
)
def test_where_scores_know_the_demonstrations_better_than_the_paths_the_promise_breaks(demonstrations, paths):
    rate, error = false_discovery_rate(demonstrations=demonstrations, paths=paths)
    assert rate > LEVEL + 10 * error


@pytest.mark.parametrize("grain", [0.0, 1.0])
def test_the_p_value_of_an_invalid_path_is_small_no_more_often_than_it_says(grain: float):
    rng = np.random.default_rng(7)
    found = []
    for _ in range(WORLDS):
        scores, valid = draw(rng, DEMONSTRATIONS + 1, grain=grain)
        p = p_values([Calibration(scores[1:], valid[1:], scores[:1])])[0]
        found.append(1.0 if valid[0] else p)  # a valid path is no false discovery
    for level in (0.02, 0.05, 0.1, 0.2, 0.4):
        assert np.mean(np.array(found) <= level) < level + 3 * (level / WORLDS) ** 0.5


@given(st.lists(st.floats(0.0001, 1.0), min_size=1, max_size=40), st.floats(0.001, 0.999))
def test_two_libraries_accept_the_same_paths(p: list[float], level: float):
    theirs = multipletests(p, alpha=level, method="fdr_bh")[1]
    near = np.isclose(theirs, level, rtol=1e-9)
    assert np.array_equal(accept(np.array(p), level)[~near], (theirs <= level)[~near])


@given(st.integers(0, 1000), st.floats(0.01, 0.5), st.floats(1.0, 4.0))
def test_a_laxer_promise_accepts_all_that_a_stricter_one_does(seed: int, level: float, more: float):
    rng = np.random.default_rng(seed)
    p = p_values([Calibration(*draw(rng, 60), draw(rng, 30)[0])])
    assert not (accept(p, level) & ~accept(p, min(level * more, 0.99))).any()


@given(st.integers(0, 1000), st.floats(0.01, 0.9))
def test_what_the_model_finds_invalid_is_accepted_only_with_all_the_rest(seed: int, level: float):
    rng = np.random.default_rng(seed)
    demonstrations, valid = draw(rng, 60)
    p = expit(draw(rng, 30)[0])
    accepted = accept(p_values([Calibration(score(expit(demonstrations)), valid, score(p))]), level)
    assert accepted.all() or not accepted[p <= 0.5].any()
    assert (p[accepted].min(initial=1) >= p[~accepted]).all()


def test_where_hardly_a_path_is_invalid_all_may_be_accepted():
    p, valid = np.linspace(0.1, 0.9, 99), np.arange(99) > 1
    assert accept(p_values([Calibration(score(p), valid, score(p))]), 0.05).all()


def test_p_values_count_invalid_demonstrations_as_high_and_ties_among_them():
    part = Calibration(np.array([0.9, 0.5, 0.5, 0.1]), np.array([True, False, True, False]), np.array([0.6, 0.5, 0.05]))
    assert p_values([part]).tolist() == [1 / 5, 2 / 5, 3 / 5]
    assert p_values([part, part]).tolist() == [1 / 9, 3 / 9, 5 / 9]


def test_a_path_between_others_is_never_less_sure_than_one_below_it():
    scores, labels = draw(np.random.default_rng(1), 50)
    candidates = np.linspace(-3, 5, 100)
    assert (np.diff(p_values([Calibration(scores, labels, candidates)])) <= 0).all()


@pytest.mark.parametrize("share", [0.2, 0.43, 1.0])
def test_one_demonstration_short_of_the_fewest_nothing_is_accepted(share: float):
    """Even if every invalid demonstration scores below every path."""
    level, paths = 0.02, 100
    fewest = fewest_demonstrations(level, share)

    def accepted(demonstrations: int) -> int:
        held_out, invalid = np.full(demonstrations, -1.0), np.zeros(demonstrations, dtype=bool)
        scores = np.where(np.arange(paths) < round(share * paths), 1.0, -2.0)
        return int(accept(p_values([Calibration(held_out, invalid, scores)]), level).sum())

    assert accepted(fewest) == round(share * paths)
    assert accepted(fewest - 1) == 0


def test_a_promise_of_two_percent_about_one_threshold_takes_114_demonstrations_without_an_error():
    n = fewest_without_error(0.02, 0.1)
    assert n == 114
    assert (1 - 0.02) ** n <= 0.1 < (1 - 0.02) ** (n - 1)


def test_who_knows_the_truth_accepts_the_most_that_the_promise_allows():
    scores, valid = draw(np.random.default_rng(2), 300)
    best = accept_knowing(scores, valid, 0.1)
    assert false_share(best, valid) <= 0.1
    for threshold in scores:
        other = scores >= threshold
        assert false_share(other, valid) > 0.1 or other.sum() <= best.sum()
    assert not accept_knowing(scores, np.zeros(300, dtype=bool), 0.1).any()


def test_what_scenes_say_averages_to_the_share_of_them_together():
    part, whole = np.array([[1, 0, 2], [0, 0, 0]]), np.array([[2, 3, 3], [0, 0, 0]])
    found = by_scene(part, whole)
    assert found.mean(-1) == pytest.approx([3 / 8, 0.0])
    assert by_scene(whole, whole)[0] == pytest.approx(np.ones(3))
