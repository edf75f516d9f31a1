"""The segmenter sees pictures relative to themselves, and says what is wrong with its weights."""

import cv2
import numpy as np
import torch

from pipeline.perception.segmenter import INPUTS, OUTLINE, network_input, segment
from tests.factories import RED, draw_table


def test_brightness_and_contrast_change_nothing():
    image = draw_table((0.5, 0.5, 0.08, RED))[None].astype(np.float32) / 255
    before, after = (network_input(x, None) for x in (image, 0.1 + 0.5 * image))
    assert before.shape == (1, INPUTS, 100, 100)
    torch.testing.assert_close(before, after, atol=1e-4, rtol=0)


def test_a_close_up_is_seen_alike_however_it_is_turned_and_mirrored():
    image = np.full((100, 100, 3), (90, 120, 160), np.uint8)
    corners = cv2.boxPoints(((45.0, 40.0), (30.0, 70.0), 25.0))
    cv2.fillConvexPoly(image, corners.astype(np.int32), (200, 60, 40))
    item = segment(image).item
    turned = segment(np.ascontiguousarray(np.rot90(image)[:, ::-1])).item
    np.testing.assert_allclose(turned, np.rot90(item)[:, ::-1], atol=1 / 255)
    assert 1500 < (item > OUTLINE).sum() < 2500  # the box has 2,100 pixels
