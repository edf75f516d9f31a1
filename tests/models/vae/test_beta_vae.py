"""Facts about the paper's model: its shapes, its two doors and its constant head."""

import numpy as np
import pytest
import torch

from pipeline.models.base import to_tensor
from tests.factories import vae


@pytest.fixture
def images():
    return np.random.default_rng(0).integers(0, 256, (3, 100, 100, 3), dtype=np.uint8)


def test_standardised_images_have_mean_0_and_variance_1_and_the_decoder_starts_from_their_mean_colour(images):
    model = vae()
    model.standardise(images // 4)
    x = (to_tensor(images // 4) - model.centre) / model.spread
    torch.testing.assert_close(x.mean((0, 2, 3)), torch.zeros(3), atol=1e-5, rtol=0)
    torch.testing.assert_close(x.std((0, 2, 3)), torch.ones(3), atol=1e-4, rtol=0)
    with torch.no_grad():
        colour = model.decode(model.perceive(to_tensor(images // 4))).mean((0, 2, 3))
    torch.testing.assert_close(colour, model.centre.flatten(), atol=0.05, rtol=0)


def test_reconstruction_over_flat_is_1_for_a_scenes_mean_colour(images):
    model = vae()
    model.standardise(images[:1])
    with torch.no_grad():
        model.decode[-2].get_parameter("weight").zero_()
    assert model.reconstruction_over_flat(images[:1]) == pytest.approx(1, abs=1e-4)
    offset = (to_tensor(images[1:2]).mean((0, 2, 3)) - model.centre.flatten()).square().mean()
    variance = to_tensor(images[1:2]).var((2, 3)).mean()
    expected = (1 + offset / variance).sqrt().item()  # of another scene
    assert model.reconstruction_over_flat(images[1:2]) == pytest.approx(expected, abs=1e-4)
