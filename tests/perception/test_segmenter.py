"""The segmenter sees pictures relative to themselves, and says what is wrong with its weights."""

import numpy as np
import torch

from pipeline.perception.segmenter import INPUTS, network_input
from tests.factories import RED, draw_table


def test_brightness_and_contrast_change_nothing():
    image = draw_table((0.5, 0.5, 0.08, RED))[None].astype(np.float32) / 255
    before, after = (network_input(x, None) for x in (image, 0.1 + 0.5 * image))
    assert before.shape == (1, INPUTS, 100, 100)
    torch.testing.assert_close(before, after, atol=1e-4, rtol=0)
