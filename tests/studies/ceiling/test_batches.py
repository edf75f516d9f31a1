"""A fit in batches follows Eq. 1, whatever the stack holds."""

import numpy as np
import pytest
import torch
from numpy import ndarray as Array

from pipeline.models.base import to_tensor, untrained
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights, equation_1
from pipeline.training.loop import Losses, Schedule, minimise
from pipeline.world.layout import SIDE
from studies.ceiling.batches import batches, fit_stack

SHAPE = {"latent": 4, "channels": (16, 8, 4), "hidden": 16}
WEIGHTS, SCHEDULE = Weights(100.0, 0.002, 6.0), Schedule(6, 0.003, 0.01, 1)


def arguments(seeds: list[int]) -> tuple[list[BetaVae], dict]:
    """A model with images and demonstrations for each seed, and what its fit takes besides."""
    models, images, z_theta, valid = [], [], [], []
    for seed in seeds:
        g = np.random.default_rng(seed)
        model = untrained(BetaVae, SHAPE, seed)
        assert isinstance(model, BetaVae)
        models.append(model)
        images.append(g.integers(0, 255, (6, SIDE, SIDE, 3), dtype=np.uint8))
        z_theta.append(g.uniform(-0.2, 1.2, (6, 5, 2)))
        valid.append(g.random((6, 5)) < 0.5)
    data = {"images": images, "z_theta": z_theta, "valid": valid}
    return models, data | {"weights": WEIGHTS, "schedule": SCHEDULE, "batch": 3, "rng": np.random.default_rng(9)}


def descend(model: BetaVae, images: Array, z_theta: Array, valid: Array, batch: int, rng: np.random.Generator) -> Array:
    """Fit a model by torch's own gradient of Eq. 1, with the latent noise of seed 0; return its learning curve."""
    model.standardise(images)
    z, labels = torch.from_numpy(z_theta).float(), torch.from_numpy(valid).float()
    chosen, generator = batches(rng, len(images), batch), torch.Generator().manual_seed(0)

    def loss() -> Losses:
        scenes = next(chosen)
        noise = torch.randn(len(scenes), model.latent, generator=generator)
        terms = equation_1(model, to_tensor(images[scenes]), z[scenes], labels[scenes], WEIGHTS, noise)
        return terms.total, [*terms, terms.total]

    return minimise(loss, model.parameters(), SCHEDULE)


def test_a_fit_in_batches_takes_the_steps_of_torch_s_gradient_of_equation_1():
    (model,), stacked = arguments([0])
    (alone,), same = arguments([0])
    (images,), (z,), (valid,) = (same[name] for name in ("images", "z_theta", "valid"))
    curve = fit_stack([model], seeds=[0], **stacked)[..., 0]
    expected = descend(alone, images, z, valid, same["batch"], same["rng"])
    np.testing.assert_allclose(curve, expected, rtol=2e-3)
    assert model.probability(images, z) == pytest.approx(alone.probability(images, z), abs=0.01)


def test_a_model_does_not_depend_on_the_others_of_its_stack():
    (one, other), both = arguments([0, 1])
    (alone,), single = arguments([1])
    fit_stack([one, other], seeds=[0, 1], **both)
    fit_stack([alone], seeds=[1], **single)
    for name, weight in alone.state_dict().items():
        np.testing.assert_array_equal(other.state_dict()[name], weight)
