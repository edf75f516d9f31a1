"""Study shift: disturbances do what their strength says, and another rule is what it says."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import default_rng as rng

from pipeline.world.layout import SIDE, SYMBOLS, Layouts, empty, random_layouts
from pipeline.world.rules import Margins
from studies.shift.stage import CORRUPTIONS, add_clutter, proximity
from tests.factories import ITEMS, RULES, assert_clear

POOL = np.arange(4)
STRONG = {"shade": 0.5, "tint": 0.4, "blur": 2.0, "noise": 0.05, "arm": 0.3}
ALL: Margins = {symbol: 0.045 for symbol in SYMBOLS}


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_corruption_of_hardly_any_strength_changes_nothing_and_a_strong_one_all_but_its_input(name: str):
    images = rng(1).integers(0, 256, (3, SIDE, SIDE, 3), dtype=np.uint8)
    np.testing.assert_array_equal(CORRUPTIONS[name](rng(0), images, 1e-9), images)
    before = images.copy()
    corrupted = CORRUPTIONS[name](rng(0), images, STRONG[name])
    np.testing.assert_array_equal(images, before)
    assert all((after != old).any() for after, old in zip(corrupted, before, strict=True))


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=5, deadline=None)
def test_clutter_adds_items_that_keep_clearances_and_moves_none(seed: int):
    layouts = random_layouts(rng(seed), 3, ITEMS, POOL, RULES)
    fuller = add_clutter(rng(seed), layouts, 2, ITEMS, POOL, RULES)
    np.testing.assert_array_equal(fuller.present.sum(1), layouts.present.sum(1) + 2)
    for field in fields(layouts):
        now, then = getattr(fuller, field.name)[:, : layouts.present.shape[1]], getattr(layouts, field.name)
        np.testing.assert_array_equal(now[layouts.present], then[layouts.present])
    assert_clear(fuller)


def glasses(*centres: tuple[float, float]) -> Layouts:
    """One scene with a glass of 3 cm radius at each of these places [m]."""
    layouts = empty(1, len(centres) + 1)
    for slot, centre in enumerate(centres):
        layouts.symbol[0, slot], layouts.item[0, slot] = SYMBOLS.index("glass"), 0
        layouts.centre[0, slot], layouts.radius[0, slot], layouts.scale[0, slot] = centre, 0.03, 1.0
    return layouts


def test_proximity_counts_a_glass_with_a_neighbour_even_if_that_is_far_from_the_path():
    straight = np.array([[[0.5, 0.5]]])
    assert proximity(glasses((0.5, 0.5)), straight, ALL, 0.2)[0, 0]
    assert not proximity(glasses((0.5, 0.5), (0.6, 0.3)), straight, ALL, 0.2)[0, 0]
    assert proximity(glasses((0.5, 0.5), (0.8, 0.3)), straight, ALL, 0.2)[0, 0]
    assert proximity(glasses((0.5, 0.5), (0.6, 0.3)), straight, dict.fromkeys(SYMBOLS), 0.2)[0, 0]
