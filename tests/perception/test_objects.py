"""Maps become one mask an item, and the trained segmenter finds items where they are."""

import numpy as np
import pytest
import torch

from pipeline.models.base import to_tensor
from pipeline.perception.objects import (
    FEATURES,
    MAX_OBJECTS,
    OUTLINE,
    SUPERSAMPLING,
    Objects,
    detect_objects,
    doubt,
    find_outlines,
)
from pipeline.perception.segmenter import LOOKS, Maps
from pipeline.world.catalogue import random_scenes
from pipeline.world.layout import SIDE, SYMBOLS, Layouts, empty
from pipeline.world.render import read_palette, render_scenes
from tests.factories import RULES

SCENES = 12


@pytest.fixture(scope="module")
def scenes() -> tuple[Layouts, np.ndarray, np.ndarray]:
    """Layouts of validation items, their images, and those of the empty tables."""
    catalogue, palette = read_palette("data")
    layouts, appearance = random_scenes(np.random.default_rng(3), SCENES, catalogue, "validation", RULES)
    textures, seeds = appearance["texture"].tolist(), appearance["render_seed"].tolist()
    bare = render_scenes(empty(SCENES, 4), textures, seeds, palette)
    return layouts, render_scenes(layouts, textures, seeds, palette), bare


@pytest.fixture(scope="module")
def detected(scenes: tuple[Layouts, np.ndarray, np.ndarray]) -> Objects:
    return detect_objects(to_tensor(scenes[1]))


def nearest(objects: Objects, layouts: Layouts, scene: int, slot: int) -> int:
    """The object nearest to an item, which must be nearer than its own radius."""
    centres = objects.ends[scene].mean(1)
    away = np.linalg.norm(centres - layouts.centre[scene, slot], axis=1)
    away[~objects.present[scene]] = np.inf
    return int(away.argmin()) if away.min() < layouts.radius[scene, slot] else -1


@pytest.mark.parametrize("with_empty", [False, True])
def test_nine_in_ten_items_are_found_and_little_is_made_up(scenes, detected: Objects, with_empty: bool):
    layouts, images, bare = scenes
    objects = detect_objects(to_tensor(images), to_tensor(bare)) if with_empty else detected
    slots = [(scene, slot) for scene in range(SCENES) for slot in np.flatnonzero(layouts.present[scene]).tolist()]
    found = [nearest(objects, layouts, scene, slot) for scene, slot in slots]
    assert np.mean(np.array(found) >= 0) > 0.9
    assert objects.present.sum() <= 1.05 * len(slots)
    off = [
        objects.radius[scene, i] - layouts.radius[scene, slot]
        for (scene, slot), i in zip(slots, found, strict=True)
        if i >= 0 and layouts.half_length[scene, slot] == 0
    ]
    assert np.median(np.abs(off)) < 0.003  # a third of a pixel


def test_glasses_are_more_see_through_than_all_else(scenes, detected: Objects):
    layouts, seen = scenes[0], {True: [], False: []}
    for scene in range(SCENES):
        for slot in np.flatnonzero(layouts.present[scene]).tolist():
            if (i := nearest(detected, layouts, scene, slot)) >= 0:
                is_glass = SYMBOLS[layouts.symbol[scene, slot]] == "glass"
                seen[is_glass].append(detected.features[scene, i, FEATURES.index("see-through")])
    assert np.median(seen[True]) > np.median(seen[False]) + 2  # log-odds


@pytest.mark.parametrize("with_empty", [False, True])
def test_an_empty_table_has_no_objects(scenes, with_empty: bool):
    bare = to_tensor(scenes[2])
    assert detect_objects(bare, bare if with_empty else None).present.sum() == 0


def test_objects_are_the_same_bits_in_any_batch_and_images_may_need_gradients(scenes, detected: Objects):
    alone = detect_objects(to_tensor(scenes[1])[4:5].requires_grad_())
    for name in ("ends", "radius", "features", "present"):
        np.testing.assert_array_equal(getattr(detected, name)[4:5], getattr(alone, name))
    assert detected.present.shape == (SCENES, MAX_OBJECTS) and torch.is_grad_enabled()


def disc(x: float, y: float, radius: float) -> np.ndarray:
    """A map that is 1 inside a disc [pixels] and falls to 0 over a pixel, OUTLINE at its edge."""
    row, column = np.mgrid[:SIDE, :SIDE] + 0.5
    return np.clip(OUTLINE + radius - np.hypot(column - x, row - y), 0, 1).astype(np.float32)


def maps(*discs: np.ndarray, between: np.ndarray | None = None) -> Maps:
    none = np.zeros((SIDE, SIDE), np.float32)
    return Maps(
        np.maximum.reduce([none, *discs]),
        none if between is None else between,
        none,
        np.full((len(LOOKS), SIDE, SIDE), 1 / len(LOOKS), np.float32),
    )


def areas(found: Maps) -> list[float]:
    """Areas of the items [pixels]."""
    return [outline.mask.sum() / SUPERSAMPLING**2 for outline in find_outlines(found)]


def test_discs_that_touch_are_cut_where_the_segmenter_says():
    left, right = disc(40, 50, 6), disc(51, 50, 5)
    gap = disc(46, 50, 2.5)
    assert len(areas(maps(left, right))) == 1
    assert areas(maps(left, right, between=gap)) == [pytest.approx(np.pi * r**2, rel=0.1) for r in (6, 5)]


def test_unsure_outlines_raise_doubt_by_their_share_and_not_by_the_number_of_items():
    def map_of(*corners: tuple[int, int]) -> np.ndarray:
        item = np.zeros((SIDE, SIDE), np.float32)
        for row, column in corners:
            item[row : row + 12, column : column + 12] = 0.5
            item[row + 1 : row + 11, column + 1 : column + 11] = 1
        return item

    one, two = doubt(map_of((10, 10))), doubt(map_of((10, 10), (60, 60)))
    assert one == pytest.approx(two, rel=1e-6) and 0.4 < one < 0.8  # an outline one pixel wide has ln 2 nat a pixel
