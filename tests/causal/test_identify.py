"""The posterior agrees with Bayes by enumeration."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.causal.identify import posterior

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
