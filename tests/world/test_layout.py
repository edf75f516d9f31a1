"""Scenes keep every clearance they promise, and an added item changes nothing else."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.world.layout import add_item, point_segment_distance, random_layouts, segment_distance
from tests.factories import ROUND_AND_OVAL as ITEMS
from tests.factories import RULES, assert_clear

POOL = np.arange(4)  # other items must not be drawn
seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, scenes: int = 6):
    return random_layouts(np.random.default_rng(seed), scenes, ITEMS, POOL, RULES)


@settings(max_examples=8, deadline=None)
@given(seeds)
def test_scenes_hold_two_or_three_items_of_the_pool_clear_of_one_another_and_of_the_ends(seed):
    layouts = drawn(seed)
    on = layouts.present
    assert set(on.sum(1)) <= {2, 3}
    assert np.isin(layouts.item[on], POOL).all()
    np.testing.assert_array_equal(ITEMS.symbol[layouts.item[on]], layouts.symbol[on])
    assert (layouts.centre[on] >= RULES.centre_low).all() and (layouts.centre[on] <= RULES.centre_high).all()
    np.testing.assert_allclose(layouts.radius[on], ITEMS.radius[layouts.item[on]] * layouts.scale[on])
    assert_clear(layouts)


@settings(max_examples=6, deadline=None)
@given(seeds, st.integers(0, 3))
def test_an_added_item_has_its_symbol_is_clear_of_the_rest_and_changes_no_other(seed, symbol):
    before = drawn(seed)
    after = add_item(np.random.default_rng(seed), before, symbol, ITEMS, POOL, RULES)
    fresh = after.present & ~before.present
    assert (fresh.sum(1) == 1).all()
    assert (after.symbol[fresh] == symbol).all()
    for field in fields(before):
        np.testing.assert_array_equal(getattr(after, field.name)[~fresh], getattr(before, field.name)[~fresh])
    assert_clear(after)


@settings(max_examples=20, deadline=None)
@given(seeds)
def test_segment_distance_agrees_with_dense_points(seed):
    a, b = np.random.default_rng(seed).uniform(size=(2, 2, 2))
    t = np.linspace(0, 1, 400)[:, None]
    p, q = a[0] + t * (a[1] - a[0]), b[0] + t * (b[1] - b[0])
    assert segment_distance(a, b) == pytest.approx(np.linalg.norm(p[:, None] - q, axis=-1).min(), abs=5e-3)
    assert point_segment_distance(a[0], a[1], a[1]) == pytest.approx(np.linalg.norm(a[0] - a[1]))  # of no length
