"""Batches cover the scenes evenly, and both fits follow Eq. 1 whatever a stack holds."""

import numpy as np
import pytest

from pipeline.models.base import untrained
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.training.loop import Schedule
from pipeline.world.layout import SIDE
from studies.ceiling.batches import fit_one, fit_stack

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


def test_a_stack_and_a_single_fit_take_the_same_steps():
    (model,), stacked = arguments([0])
    (alone,), single = arguments([0])
    single |= {name: single[name][0] for name in ("images", "z_theta", "valid")}
    curve, expected = fit_stack([model], seeds=[0], **stacked)[..., 0], fit_one(alone, seed=0, paths=5, **single)
    np.testing.assert_allclose(curve, expected, rtol=2e-3)
    images, z = single["images"], single["z_theta"]
    assert model.probability(images, z) == pytest.approx(alone.probability(images, z), abs=0.01)


def test_a_model_does_not_depend_on_the_others_of_its_stack():
    (one, other), both = arguments([0, 1])
    (alone,), single = arguments([1])
    fit_stack([one, other], seeds=[0, 1], **both)
    fit_stack([alone], seeds=[1], **single)
    for name, weight in alone.state_dict().items():
        np.testing.assert_array_equal(other.state_dict()[name], weight)
