"""The segmenter sees pictures relative to themselves, and says what is wrong with its weights."""

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from making.segmenter.train import folded
from pipeline.perception.segmenter import INPUTS, Segmenter, network_input, read_segmenter
from pipeline.runtime.errors import InputError
from tests.factories import RED, draw_table


def test_brightness_and_contrast_change_nothing():
    image = draw_table((0.5, 0.5, 0.08, RED))[None].astype(np.float32) / 255
    before, after = (network_input(x, None) for x in (image, 0.1 + 0.5 * image))
    assert before.shape == (1, INPUTS, 100, 100)
    torch.testing.assert_close(before, after, atol=1e-4, rtol=0)


def test_folding_keeps_the_function():
    torch.manual_seed(0)
    trained = Segmenter(normalised=True)
    trained(torch.randn(4, INPUTS, 100, 100))  # moves the running means
    inputs = torch.randn(2, INPUTS, 100, 100)
    torch.testing.assert_close(trained.eval()(inputs), folded(trained)(inputs), atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("content", ["nothing", "no weights", "other weights"])
def test_unusable_weights_are_named(tmp_path: Path, content: str):
    path = tmp_path / "segmenter.safetensors"
    if content == "no weights":
        path.write_text("x")
    elif content == "other weights":
        save_file({"weight": torch.zeros(1)}, path)
    with pytest.raises(InputError, match=rf"{path.name}.*make segmenter"):
        read_segmenter(path)
