"""Facts about the paper's model: its shapes, its two doors and its constant head."""

import numpy as np
import pytest
import torch

from pipeline.models.base import to_tensor
from pipeline.models.registry import build
from tests.factories import vae


@pytest.fixture
def images():
    return np.random.default_rng(0).integers(0, 256, (3, 100, 100, 3), dtype=np.uint8)


@pytest.fixture
def z_theta():
    return np.random.default_rng(1).uniform(-0.2, 1.2, (3, 5, 2))


def test_decoder_mirrors_the_encoder(images):
    model = vae()
    shapes = [(3, 100, 100)]
    x = to_tensor(images[:1])
    for layer in model.features:
        x = layer(x)
        if isinstance(layer, torch.nn.Conv2d):
            shapes.append(tuple(x.shape[1:]))
    back, x = [], model.perceive(to_tensor(images[:1]))
    assert x.shape == (1, 15)
    for layer in model.decode:
        x = layer(x)
        if isinstance(layer, torch.nn.Unflatten | torch.nn.ConvTranspose2d):
            back.append(tuple(x.shape[1:]))
    assert shapes == [(3, 100, 100), (16, 50, 50), (8, 25, 25), (4, 13, 13)]
    assert back == shapes[::-1]


def test_the_paths_of_a_scene_do_not_see_one_another(images, z_theta):
    model = vae()
    together = model.probability(images, z_theta)
    one = model.probability(images[1:2], z_theta[1:2, 3:4])
    assert together.dtype == np.float32 and together.shape == (3, 5)
    np.testing.assert_allclose(one[0, 0], together[1, 3], rtol=1e-6)


def test_a_traversal_through_the_images_own_value_gives_its_reconstruction(images):
    model = vae()
    with torch.no_grad():
        z_image = model.perceive(to_tensor(images[:1]))[0].numpy()
    moved = model.traverse(images[0], z_image)  # dimension i at value i leaves z_image as it is
    again = model.reconstruct(images[:1])[0].astype(int)
    assert again.shape == (100, 100, 3) and moved.shape == (15, 15, 100, 100, 3) and moved.dtype == np.uint8
    assert all(np.abs(moved[i, i].astype(int) - again).max() <= 1 for i in range(15))


def test_standardised_images_have_mean_0_and_variance_1_and_the_decoder_starts_from_their_mean_colour(images):
    model = vae()
    model.standardise(images // 4)
    x = (to_tensor(images // 4) - model.centre) / model.spread
    torch.testing.assert_close(x.mean((0, 2, 3)), torch.zeros(3), atol=1e-5, rtol=0)
    torch.testing.assert_close(x.std((0, 2, 3)), torch.ones(3), atol=1e-4, rtol=0)
    colour = model.reconstruct(images // 4).mean((0, 1, 2)) / 255
    np.testing.assert_allclose(colour, model.centre.flatten(), atol=0.05)


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


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match=r"kind 'tree'.*vae"):
        build({"kind": "tree"})
