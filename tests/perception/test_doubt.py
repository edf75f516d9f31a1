"""Doubt about a picture: the entropy of its item map over the length of its outlines."""

import numpy as np
import pytest

from pipeline.perception.doubt import doubt

DISC = np.hypot(*(np.mgrid[:100, :100] - 50)) < 10


def test_a_map_that_is_sure_of_every_pixel_raises_no_doubt():
    assert doubt(DISC.astype(np.float32)) == doubt(np.zeros((100, 100), np.float32)) == 0


def test_unsure_outlines_count_by_their_share_and_not_by_the_number_of_items():
    def map_of(*corners: tuple[int, int]) -> np.ndarray:
        item = np.zeros((100, 100), np.float32)
        for row, column in corners:
            item[row : row + 12, column : column + 12] = 0.5
            item[row + 1 : row + 11, column + 1 : column + 11] = 1
        return item

    one, two = doubt(map_of((10, 10))), doubt(map_of((10, 10), (60, 60)))
    assert one == pytest.approx(two, rel=1e-6) and 0.4 < one < 0.8  # an outline one pixel wide has ln 2 nat a pixel


def test_an_item_that_is_almost_missed_raises_doubt():
    sure = DISC.astype(np.float32)
    assert doubt(np.maximum(sure, 0.3 * np.roll(sure, 30, 1))) > doubt(sure) + 1
