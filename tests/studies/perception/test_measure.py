"""Objects are compared with the truth item by item."""

import numpy as np
import pytest

from making.segmenter.pool import between
from pipeline.perception.objects import FEATURES, MAX_OBJECTS, Objects
from pipeline.world.layout import SIDE
from studies.perception.measure import match


def picture(*discs: tuple[float, float, float]) -> np.ndarray:
    """Instances of discs (x, y, radius) [m]."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    instances = np.zeros((SIDE, SIDE), np.uint8)
    for i, (at_x, at_y, radius) in enumerate(discs, 1):
        instances[np.hypot(x - SIDE * at_x, SIDE * (1 - at_y) - y) < SIDE * radius] = i
    return instances


def objects(*discs: tuple[float, float, float]) -> Objects:
    """Detected discs (x, y, radius) [m]."""
    none = np.zeros((1, MAX_OBJECTS), np.float32)
    found = Objects(
        np.zeros((1, MAX_OBJECTS, 2, 2), np.float32),
        none,
        np.zeros((1, MAX_OBJECTS, len(FEATURES)), np.float32),
        none > 0,
        np.zeros(1, np.float32),
    )
    for i, (x, y, radius) in enumerate(discs):
        found.ends[0, i], found.radius[0, i], found.present[0, i] = (x, y), radius, True
    return found


PLATE, GLASS = (0.3, 0.4, 0.08), (0.7, 0.6, 0.04)


def test_the_true_discs_match_whatever_their_order():
    matches = match(objects(GLASS, PLATE), 0, picture(PLATE, GLASS))
    assert matches.item.tolist() == [1, 2] and matches.made_up == 0
    assert matches.iou == pytest.approx([1, 1], abs=0.1)


def test_a_missed_item_has_no_overlap_and_an_object_elsewhere_is_made_up():
    matches = match(objects(PLATE, (0.1, 0.9, 0.05)), 0, picture(PLATE, GLASS))
    assert matches.iou == pytest.approx([1, 0], abs=0.1) and matches.made_up == 1
    assert match(objects(), 0, picture(PLATE)).iou.tolist() == [0]
    assert match(objects(PLATE), 0, picture()).made_up == 1


def test_only_pixels_near_two_items_are_between_them():
    assert between(picture(PLATE, GLASS)).sum() == 0
    close = between(picture(PLATE, (PLATE[0] + 0.08 + 0.04 + 0.01, 0.4, 0.04)))
    assert 5 < close.sum() < 60
