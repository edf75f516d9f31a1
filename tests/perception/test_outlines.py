"""Maps become one mask an item, and raise doubt where they are unsure."""

import numpy as np
import pytest

from pipeline.perception.outlines import MIN_ITEM_PX, OUTLINE, SUPERSAMPLING, doubt, find_outlines
from pipeline.perception.segmenter import Maps
from pipeline.world.layout import SIDE


def disc(x: float, y: float, radius: float) -> np.ndarray:
    """A map that is 1 inside a disc [pixels] and falls to 0 over a pixel, OUTLINE at its edge."""
    row, column = np.mgrid[:SIDE, :SIDE] + 0.5
    return np.clip(OUTLINE + radius - np.hypot(column - x, row - y), 0, 1).astype(np.float32)


def maps(*discs: np.ndarray, between: np.ndarray | None = None) -> Maps:
    none = np.zeros((SIDE, SIDE), np.float32)
    return Maps(np.maximum.reduce([none, *discs]), none if between is None else between, none)


def areas(found: Maps) -> list[float]:
    """Areas of the items [pixels]."""
    return [outline.mask.sum() / SUPERSAMPLING**2 for outline in find_outlines(found)]


@pytest.mark.parametrize("radius", [3.0, 4.3, 8.7])
def test_a_disc_keeps_its_area_to_a_fraction_of_a_pixel(radius: float):
    assert areas(maps(disc(40.3, 60.8, radius))) == [pytest.approx(np.pi * radius**2, rel=0.03)]


def test_discs_that_touch_are_cut_where_the_segmenter_says():
    left, right = disc(40, 50, 6), disc(51, 50, 5)
    gap = disc(46, 50, 2.5)
    assert len(areas(maps(left, right))) == 1
    assert areas(maps(left, right, between=gap)) == [pytest.approx(np.pi * r**2, rel=0.1) for r in (6, 5)]


def test_a_ring_is_a_filled_item_and_a_speck_is_none():
    ring = disc(50, 50, 7) - disc(50, 50, 4)
    assert areas(maps(ring)) == [pytest.approx(np.pi * 49, rel=0.03)]
    assert areas(maps(disc(50, 50, 0.9 * np.sqrt(MIN_ITEM_PX / np.pi)))) == []


def test_only_unsure_pixels_raise_doubt_and_an_item_that_is_almost_missed_much():
    sure = (np.hypot(*(np.mgrid[:SIDE, :SIDE] - 50)) < 10).astype(np.float32)
    assert doubt(sure) == doubt(np.zeros((SIDE, SIDE), np.float32)) == 0
    assert doubt(np.maximum(sure, 0.3 * np.roll(sure, 30, 1))) > 1


def test_unsure_outlines_count_by_their_share_and_not_by_the_number_of_items():
    def map_of(*corners: tuple[int, int]) -> np.ndarray:
        item = np.zeros((SIDE, SIDE), np.float32)
        for row, column in corners:
            item[row : row + 12, column : column + 12] = 0.5
            item[row + 1 : row + 11, column + 1 : column + 11] = 1
        return item

    one, two = doubt(map_of((10, 10))), doubt(map_of((10, 10), (60, 60)))
    assert one == pytest.approx(two, rel=1e-6) and 0.4 < one < 0.8  # an outline one pixel wide has ln 2 nat a pixel
