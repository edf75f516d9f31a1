"""Glasses stand beside plates as often as asked, under every clearance, and nothing else changes."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.layout import Items, Layouts, point_segment_distance, segment_distance
from studies.confounding.world import GLASS, PLATE, Confounding, confounded_layouts
from tests.factories import RULES

pytestmark = pytest.mark.slow

# Per symbol a training item (0-3) and another one (4-7); the plate and the glass of the latter are oval.
ITEMS = Items(
    np.tile(np.arange(4), 2),
    np.array([0.0, 0.0, 0.08, 0.0, 0.0, 0.038, 0.07, 0.015]),
    np.array([0.065, 0.075, 0.013, 0.045, 0.06, 0.054, 0.013, 0.0375]),
)
CONFOUNDING = Confounding(p_common_cause=0.9, present=0.8, glasses=2, gap_low=0.015, gap_high=0.04)
ROUND, OVAL = np.arange(4), np.arange(4, 8)
seeds = st.integers(0, 2**32 - 1)


def drawn(seed: int, scenes: int, pool: np.ndarray = ROUND, **changes) -> Layouts:
    return confounded_layouts(np.random.default_rng(seed), scenes, ITEMS, pool, RULES, replace(CONFOUNDING, **changes))


def gaps(layouts: Layouts, scene: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the gaps [m] between the footprints of the items of two sets of slots."""
    ends, radius = layouts.ends[scene], layouts.radius[scene]
    return segment_distance(ends[first][:, None], ends[second]) - radius[first][:, None] - radius[second]


@pytest.mark.parametrize("pool", [ROUND, OVAL])
@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_footprints_keep_the_clearances(pool, seed):
    layouts = drawn(seed, 4, pool)
    for scene in range(len(layouts)):
        slots = np.flatnonzero(layouts.present[scene])
        apart = gaps(layouts, scene, slots, slots)[~np.eye(len(slots), dtype=bool)]
        assert apart.size == 0 or apart.min() >= RULES.clear_of_items - 1e-5
        for p in (P_INIT, P_F):
            a, b = layouts.ends[scene, slots, 0], layouts.ends[scene, slots, 1]
            assert (point_segment_distance(p, a, b) - layouts.radius[scene, slots] >= RULES.clear_of_ends).all()
        centre = layouts.centre[scene, slots]
        assert ((centre >= RULES.centre_low) & (centre <= RULES.centre_high)).all()
        assert set(layouts.item[scene, slots]) <= set(pool)


@pytest.mark.parametrize("pool", [ROUND, OVAL])
def test_with_a_common_cause_every_glass_stands_beside_a_plate(pool):
    layouts = drawn(1, 30, pool, p_common_cause=1.0)
    for scene in range(len(layouts)):
        plates, glasses = (np.flatnonzero(layouts.symbol[scene] == s) for s in (PLATE, GLASS))
        assert (len(plates), len(glasses)) in ((0, 0), (1, CONFOUNDING.glasses))
        if len(plates):
            apart = gaps(layouts, scene, plates, glasses)
            assert ((apart >= CONFOUNDING.gap_low - 1e-5) & (apart <= CONFOUNDING.gap_high + 1e-5)).all()


def test_a_stronger_cause_changes_more_scenes_and_leaves_the_others_as_they_are():
    weak, strong, full = (drawn(4, 40, p_common_cause=t) for t in (0.5, 0.8, 1.0))

    def same(a: Layouts, b: Layouts) -> np.ndarray:
        return np.all([(getattr(a, f.name) == getattr(b, f.name)).reshape(40, -1).all(1) for f in fields(a)], 0)

    assert same(weak, full).mean() == pytest.approx(0.5, abs=0.2)
    assert same(strong, full).mean() == pytest.approx(0.8, abs=0.17)
    assert same(strong, full)[same(weak, full)].all()


def test_a_scene_without_room_for_its_glasses_is_refused():
    with pytest.raises(ValueError, match="no free slot for a glass"):
        drawn(6, 20, glasses=4)
