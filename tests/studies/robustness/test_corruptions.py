"""Corruptions do what their strength says, deepen as it grows, and change nothing else."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.layout import SIDE, point_segment_distance, random_layouts, segment_distance
from studies.robustness.corruptions import ARM_RADIUS_PX, CORRUPTIONS, add_clutter, arm, flip_labels, noise, tint
from tests.factories import ITEMS, RULES

POOL = np.arange(4)
STRONG = {"shade": 0.5, "tint": 0.4, "blur": 2.0, "noise": 0.05, "arm": 0.3}
seeds = st.integers(0, 2**32 - 1)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def any_images(count: int = 3) -> np.ndarray:
    return rng(1).integers(0, 256, (count, SIDE, SIDE, 3), dtype=np.uint8)


def grey(level: int, count: int = 1) -> np.ndarray:
    return np.full((count, SIDE, SIDE, 3), level, np.uint8)


@pytest.mark.parametrize("name", CORRUPTIONS)
def test_a_corruption_of_hardly_any_strength_changes_nothing_and_a_strong_one_all_but_its_input(name: str):
    images = any_images()
    np.testing.assert_array_equal(CORRUPTIONS[name](rng(), images, 1e-9), images)
    images = any_images()
    before = images.copy()
    corrupted = CORRUPTIONS[name](rng(), images, STRONG[name])
    np.testing.assert_array_equal(images, before)
    assert all((after != old).any() for after, old in zip(corrupted, before, strict=True))
    np.testing.assert_array_equal(CORRUPTIONS[name](rng(), images, STRONG[name]), corrupted)


@pytest.mark.parametrize("name", ["shade", "noise", "arm"])
def test_a_stronger_corruption_deepens_a_weaker_one(name: str):
    weak, strong = (np.abs(CORRUPTIONS[name](rng(), grey(128, 3), s * STRONG[name]) - 128.0) for s in (0.5, 1.0))
    touched = weak > 0
    assert touched.any() and (strong[touched] >= weak[touched] - 1).all() and strong.sum() > weak.sum()


def test_tint_and_noise_take_what_their_strength_says():
    assert tint(rng(), grey(200), 0.4)[0, 50, 50].tolist() == [200, 160, 120]
    error = noise(rng(), grey(128, 4), 0.05) / 255 - 128 / 255
    assert error.std() == pytest.approx(0.05, rel=0.02) and abs(error.mean()) < 0.001


@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_an_arm_crosses_one_edge_and_has_the_given_reach_and_thickness(seed: int):
    over = (arm(rng(seed), grey(0), 0.3)[0] > 0).all(-1)
    touched = [edge for edge in range(4) if np.rot90(over, -edge)[0].any()]
    assert len(touched) == 1, "it crosses one edge"
    upright = np.rot90(over, -touched[0])
    assert abs(upright.any(1).sum() - 0.3 * SIDE) <= 1 and abs(upright[0].sum() - 2 * ARM_RADIUS_PX) <= 1


@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_clutter_adds_items_that_keep_clearances_and_moves_none(seed: int):
    layouts = random_layouts(rng(seed), 3, ITEMS, POOL, RULES)
    fuller = add_clutter(rng(seed), layouts, 2, ITEMS, POOL, RULES)
    np.testing.assert_array_equal(fuller.present.sum(1), layouts.present.sum(1) + 2)
    for scene in range(len(layouts)):
        slots, before = np.flatnonzero(fuller.present[scene]), np.flatnonzero(layouts.present[scene])
        for f in fields(layouts):
            np.testing.assert_array_equal(
                getattr(fuller, f.name)[scene, before], getattr(layouts, f.name)[scene, before]
            )
        ends, radius = fuller.ends[scene, slots], fuller.radius[scene, slots]
        apart = segment_distance(ends[:, None], ends) - radius[:, None] - radius
        assert apart[~np.eye(len(slots), dtype=bool)].min() >= RULES.clear_of_items - 1e-9
        for p in (P_INIT, P_F):
            assert (point_segment_distance(p, ends[:, 0], ends[:, 1]) - radius >= RULES.clear_of_ends - 1e-9).all()


def test_less_clutter_and_fewer_flips_are_part_of_more():
    layouts, labels = random_layouts(rng(), 4, ITEMS, POOL, RULES), rng().random((20, 9)) < 0.4
    some, more = (add_clutter(rng(), layouts, count, ITEMS, POOL, RULES) for count in (1, 3))
    first = np.nonzero(some.present)
    np.testing.assert_array_equal(more.centre[first], some.centre[first])
    np.testing.assert_array_equal(more.item[first], some.item[first])
    few, many = (flip_labels(rng(3), labels, share) != labels for share in (0.05, 0.2))
    assert (many | ~few).all()


@pytest.mark.slow
def test_a_scene_without_room_for_clutter_is_refused():
    layouts = random_layouts(rng(), 1, ITEMS, POOL, RULES)
    with pytest.raises(ValueError, match="the scene is too full"):
        add_clutter(rng(), layouts, 1, ITEMS, POOL, replace(RULES, clear_of_items=0.9))


@pytest.mark.parametrize(("share", "flipped"), [(0.0, 0), (0.05, 9), (0.004, 1), (0.002, 0), (1.0, 180)])
def test_the_number_of_flipped_labels_is_the_share_rounded(share: float, flipped: int):
    labels = rng().random((20, 9)) < 0.4
    assert (flip_labels(rng(), labels, share) != labels).sum() == flipped
