"""Clear cases are different paths, far from the boundary, and half of them valid."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.world.clear_cases import clear_cases


@given(seed=st.integers(0, 1000), clear_m=st.sampled_from([0.0, 0.05, 0.1]), shift=st.sampled_from([-0.3, 0.0, 0.05]))
@settings(max_examples=40, deadline=None)
def test_cases_are_different_and_clear_and_others_fill_in_only_where_a_scene_has_too_few(seed, clear_m, shift):
    rng = np.random.default_rng(seed)
    slacks = rng.uniform(-0.15, 0.15, 200) + shift
    chosen = clear_cases(rng, slacks, clear_m, 20)
    assert len(set(chosen.tolist())) == 20
    clear = (slacks > clear_m) | (slacks <= -clear_m)
    if clear.sum() >= 20:
        assert clear[chosen].all()
    else:
        assert set(np.flatnonzero(clear)) <= set(chosen.tolist())


def test_half_of_the_clear_cases_are_valid_where_most_paths_are():
    rng = np.random.default_rng(0)
    slacks = rng.uniform(-0.05, 0.3, 2000)
    shares = [(slacks[clear_cases(rng, slacks, 0.02, 20)] > 0).mean() for _ in range(200)]
    assert np.mean(shares) == pytest.approx(0.5, abs=0.03) and np.std(shares) > 0.05
