"""The posterior agrees with Bayes by enumeration, the open-set test with its exact distribution."""

from itertools import product

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.causal.identify import STEP_NATS, critical_surprise, posterior, reject_all_users

TINY = 1e-9


def drawn(seed: int, users: int = 3, seeds: int = 2, scenes: int = 4, draws: int = 5, paths: int = 6):
    """p (user, seed, scene, draw, path) of models and valid (user, scene, draw, path) of users, unrelated."""
    rng = np.random.default_rng(seed)
    return rng.uniform(size=(users, seeds, scenes, draws, paths)), rng.random((users, scenes, draws, paths)) < 0.6


@settings(deadline=None)
@given(st.integers(0, 999))
def test_the_posterior_is_bayes_rule(seed: int):
    p, valid = drawn(seed, paths=4)
    belief = posterior(p, valid[1], TINY)
    first = np.prod(np.where(valid[1], p, 1 - p)[..., :3], axis=-1)
    np.testing.assert_allclose(belief[..., 2], first / first.sum(0))
    np.testing.assert_allclose(belief.sum(0), 1)


@settings(deadline=None)
@given(st.lists(st.tuples(st.integers(0, 12), st.floats(0.01, 1.0)), min_size=1, max_size=6), st.floats(0.01, 0.5))
def test_the_critical_surprise_agrees_with_enumeration(labels: list, level: float):
    weight = np.array([w for w, _ in labels])
    rare = np.array([share / (1 + np.exp(STEP_NATS * w)) for w, share in labels])  # at most as rare as the weight says
    critical = critical_surprise(weight, rare, level)
    for k in range(1, len(labels) + 1):
        outcomes = np.array(list(product([0, 1], repeat=k)))
        chance = np.where(outcomes, rare[:k], 1 - rare[:k]).prod(1)
        surprise = outcomes @ weight[:k]
        assert chance[surprise >= critical[k - 1]].sum() <= level + 1e-9
        assert chance[surprise >= critical[k - 1] - 1].sum() > level - 1e-9


def test_the_ideal_observer_rejects_a_stranger_once_it_contradicts_every_user():
    valid = np.random.default_rng(9).random((4, 6, 5, 7)) < 0.7  # the stranger last
    none = reject_all_users(valid[:3, None].astype(float), valid, TINY, 0.05)
    contradicted = (valid[None, :3] != valid[:, None]).cumsum(-1) > 0  # (who, user, scene, draw, path)
    expected = np.moveaxis(contradicted.all(1).mean(2), -1, 1)[:, :, None]
    np.testing.assert_allclose(none, expected)
    assert (none[:3] == 0).all()
