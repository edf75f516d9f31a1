"""Facts about torch's engine: its curves, its steps in double precision, repeated bits, and the choice of an engine."""

import copy
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.models.base import to_tensor
from pipeline.models.vae.losses import equation_1
from pipeline.training.loop import Checkpoints, Schedule
from pipeline.training.vae.engines import engine, fit_batch
from tests.factories import WEIGHTS, noise_demos, vae

GOLDEN = Path(__file__).parents[3] / "golden"
SHORT = Schedule(steps=20, rate=2e-3, weight_decay=0.01, curve_every=5)
NS = (4, 1, 9)


def discs(scenes: int = 4, n: int = 5):
    """Grey tables with a bright disc each; a path is valid if its control point is left of the disc."""
    rng = np.random.default_rng(11)
    centre = rng.uniform(0.3, 0.7, (scenes, 2))
    y, x = np.mgrid[99:-1:-1, 0:100] / 100
    disc = (x - centre[:, 0, None, None]) ** 2 + (y - centre[:, 1, None, None]) ** 2 < 0.1**2
    images = np.where(disc[..., None], 230, 90).repeat(3, -1).astype(np.uint8)
    z_theta = rng.uniform(-0.2, 1.2, (scenes, n, 2))
    return images, z_theta, z_theta[..., 0] < centre[:, :1]


@pytest.mark.parametrize("variant", WEIGHTS)
def test_the_learning_curve_is_the_golden_one_and_its_terms_add_up_to_its_total(variant):
    (curve,) = fit_batch([vae(1)], *([x] for x in discs()), weights=WEIGHTS[variant], schedule=SHORT, seeds=[1])
    golden = np.loadtxt(GOLDEN / f"curve_{variant}.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(curve, golden, rtol=5e-3, atol=1e-5)
    np.testing.assert_allclose(curve[:, 1:4].sum(1), curve[:, 4], rtol=1e-5)


def exact(model, images, z_theta, valid, weights, schedule, seed):
    """The steps of gradient descent on Eq. 1 written out, in double precision; the losses before each."""
    x, z, labels = to_tensor(images).double(), torch.from_numpy(z_theta), torch.from_numpy(valid)
    generator = torch.Generator().manual_seed(seed)
    model.standardise(images)
    rate, decay = schedule.rate, schedule.weight_decay
    optimiser = torch.optim.AdamW(model.parameters(), lr=rate, betas=(0.9, schedule.adam_beta2), weight_decay=decay)
    cycle = torch.optim.lr_scheduler.OneCycleLR(optimiser, rate, total_steps=schedule.steps)
    losses = []
    for _ in range(schedule.steps):
        noise = torch.randn(len(x), model.latent, generator=generator).double()
        loss = equation_1(model, x, z, labels, weights, noise).total
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        cycle.step()
        losses.append(loss.item())
    return losses


@pytest.mark.parametrize("variant", WEIGHTS)
def test_models_of_any_n_take_the_steps_of_equation_1_in_double_precision(variant):
    schedule = Schedule(steps=3, rate=2e-3, weight_decay=0.01, curve_every=1)
    ours = [vae(seed).double() for seed in range(len(NS))]
    theirs = copy.deepcopy(ours)
    sets = [noise_demos(seed, n=n) for seed, n in enumerate(NS)]
    images, z_theta, valid = zip(*sets, strict=True)
    curves = fit_batch(ours, images, z_theta, valid, WEIGHTS[variant], schedule, range(len(NS)))
    for seed, (model, plain) in enumerate(zip(ours, theirs, strict=True)):
        losses = exact(plain, *sets[seed], WEIGHTS[variant], schedule, seed)
        np.testing.assert_allclose(curves[seed][:, -1], losses, rtol=1e-9)
        for name, wanted in plain.named_parameters():
            error = (model.get_parameter(name) - wanted).norm()
            assert error <= 1e-6 * wanted.norm(), f"{name} of model {seed}: {error:.1e}"


@pytest.mark.parametrize("name", ["reference", "simd"])
@pytest.mark.parametrize("label", [True, False])
def test_labels_that_never_vary_give_laplaces_constant_without_training(name, label):
    (images, z_theta, valid), model, checkpoints = discs(), vae(1), Checkpoints([0])
    arguments = [model], [images], [z_theta], [np.full_like(valid, label)], WEIGHTS["full"], SHORT, [1], checkpoints
    (curve,) = engine(name).fit(*arguments)
    assert not checkpoints.of(model)
    expected = 21 / 22 if label else 1 / 22  # 20 demonstrations
    np.testing.assert_allclose(model.probability(images, z_theta), expected, rtol=1e-5)
    assert torch.equal(model.mean.weight, vae(1).mean.weight)
    assert curve.shape == (1, 5) and curve[0, 4] == pytest.approx(-np.log(21 / 22))
