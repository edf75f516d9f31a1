"""Facts about training in a batch: what it computes is what the reference does, whatever the models' n."""

import copy

import numpy as np
import pytest
import torch

from pipeline.models.base import to_tensor
from pipeline.models.vae.losses import equation_1
from pipeline.training.loop import Checkpoints, Schedule
from pipeline.training.vae.engines.cuda import fit_batch
from pipeline.training.vae.engines.reference import fit
from tests.factories import WEIGHTS, vae

SHORT = Schedule(steps=3, rate=2e-3, weight_decay=0.01, curve_every=1)
NS = (4, 1, 9)


def data(seed: int, n: int, scenes: int = 3):
    """Noise for images and paths; the first two demonstrations differ."""
    rng = np.random.default_rng(seed)
    valid = rng.random((scenes, n)) < 0.4
    valid.flat[:2] = False, True
    return rng.integers(0, 256, (scenes, 100, 100, 3), dtype=np.uint8), rng.uniform(-0.2, 1.2, (scenes, n, 2)), valid


def exact(model, images, z_theta, valid, weights, seed):
    """The reference's steps in double precision; the losses before each."""
    x, z, labels = to_tensor(images).double(), torch.from_numpy(z_theta), torch.from_numpy(valid)
    generator = torch.Generator().manual_seed(seed)
    model.standardise(images)
    optimiser, cycle = SHORT.optimiser(model.parameters())
    losses = []
    for _ in range(SHORT.steps):
        noise = torch.randn(len(x), model.latent, generator=generator).double()
        loss = equation_1(model, x, z, labels, weights, noise).total
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        cycle.step()
        losses.append(loss.item())
    return losses


@pytest.mark.parametrize("variant", WEIGHTS)
def test_in_double_precision_its_weights_are_the_references(variant):
    ours = [vae(seed).double() for seed in range(len(NS))]
    theirs = copy.deepcopy(ours)
    sets = [data(seed, n) for seed, n in enumerate(NS)]
    images, z_theta, valid = zip(*sets, strict=True)
    curves = fit_batch(ours, images, z_theta, valid, WEIGHTS[variant], SHORT, range(len(NS)))
    for seed, (model, reference) in enumerate(zip(ours, theirs, strict=True)):
        losses = exact(reference, *sets[seed], WEIGHTS[variant], seed)
        np.testing.assert_allclose(curves[seed][:, -1], losses, rtol=1e-9)
        for name, wanted in reference.named_parameters():
            error = (model.get_parameter(name) - wanted).norm()
            assert error <= 1e-6 * wanted.norm(), f"{name} of model {seed}: {error:.1e}"


def test_it_fits_what_the_reference_fits_and_constants_beside():
    ours, theirs = [vae(seed) for seed in range(2)], [vae(seed) for seed in range(2)]
    images, z_theta, valid = zip(data(0, 4), data(1, 2), strict=True)
    valid = valid[0], np.ones_like(valid[1])
    checkpoints, their_checkpoints = Checkpoints([2]), Checkpoints([2])
    curves = fit_batch(ours, images, z_theta, valid, WEIGHTS["full"], SHORT, [5, 6], checkpoints)
    for i, (model, reference) in enumerate(zip(ours, theirs, strict=True)):
        curve = fit(reference, images[i], z_theta[i], valid[i], WEIGHTS["full"], SHORT, 5 + i, their_checkpoints)
        np.testing.assert_allclose(curves[i], curve, rtol=1e-4, atol=1e-6)
        halfway, wanted = checkpoints.of(model), their_checkpoints.of(reference)
        assert halfway.keys() == wanted.keys() and len(wanted) == int(i == 0)  # the second is a constant
        for step, state in wanted.items():
            for name, value in state.items():
                np.testing.assert_allclose(halfway[step][name], value, rtol=0, atol=2e-4)
        for name, value in reference.state_dict().items():
            torch.testing.assert_close(model.state_dict()[name], value, rtol=0, atol=2e-4)  # rate x steps is 6e-3


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs CUDA")
def test_on_cuda_the_same_batch_gives_the_same_bits():
    runs = [[vae(seed) for seed in range(len(NS))] for _ in range(2)]
    images, z_theta, valid = zip(*(data(seed, n) for seed, n in enumerate(NS)), strict=True)
    for models in runs:
        fit_batch(models, images, z_theta, valid, WEIGHTS["full"], SHORT, range(len(NS)))
    for first, again in zip(*runs, strict=True):
        assert all(torch.equal(value, again.state_dict()[name]) for name, value in first.state_dict().items())
