"""Facts about the paper's model: what it is before training."""

import numpy as np
import torch

from pipeline.models.base import to_tensor
from tests.factories import vae


def test_standardised_images_have_mean_0_and_variance_1_and_the_decoder_starts_from_their_mean_colour():
    images = np.random.default_rng(0).integers(0, 64, (3, 100, 100, 3), dtype=np.uint8)
    model = vae()
    model.standardise(images)
    x = (to_tensor(images) - model.centre) / model.spread
    torch.testing.assert_close(x.mean((0, 2, 3)), torch.zeros(3), atol=1e-5, rtol=0)
    torch.testing.assert_close(x.std((0, 2, 3)), torch.ones(3), atol=1e-4, rtol=0)
    with torch.no_grad():
        colour = model.decode(model.perceive(to_tensor(images))).mean((0, 2, 3))
    torch.testing.assert_close(colour, model.centre.flatten(), atol=0.05, rtol=0)
