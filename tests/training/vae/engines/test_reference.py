"""The reference engine repeats bit for bit, learns, and gives constant labels a constant."""

from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.runtime.streams import job_seed
from pipeline.training.loop import Checkpoints, Schedule
from pipeline.training.vae.engines.reference import fit
from tests.factories import WEIGHTS, vae

GOLDEN = Path(__file__).parents[3] / "golden"
SHORT = Schedule(steps=20, rate=2e-3, weight_decay=0.01, curve_every=5)


def data(scenes: int = 4, n: int = 5):
    """Grey tables with a bright disc each; a path is valid if its control point is left of the disc."""
    rng = np.random.default_rng(11)
    centre = rng.uniform(0.3, 0.7, (scenes, 2))
    y, x = np.mgrid[99:-1:-1, 0:100] / 100
    disc = (x - centre[:, 0, None, None]) ** 2 + (y - centre[:, 1, None, None]) ** 2 < 0.1**2
    images = np.where(disc[..., None], 230, 90).repeat(3, -1).astype(np.uint8)
    z_theta = rng.uniform(-0.2, 1.2, (scenes, n, 2))
    return images, z_theta, z_theta[..., 0] < centre[:, :1]


def trained(variant: str = "full", seed: int = 1, schedule: Schedule = SHORT):
    model = vae(seed)
    curve = fit(model, *data(), WEIGHTS[variant], schedule, seed)
    return model, curve


@pytest.mark.parametrize("variant", WEIGHTS)
def test_the_learning_curve_is_the_golden_one_and_its_terms_add_up_to_its_total(variant):
    _, curve = trained(variant)
    golden = np.loadtxt(GOLDEN / f"curve_{variant}.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(curve, golden, rtol=5e-3, atol=1e-5)
    np.testing.assert_allclose(curve[:, 1:4].sum(1), curve[:, 4], rtol=1e-5)
    assert list(curve[:, 0]) == [0, 5, 10, 15, 19]


def test_the_same_seed_gives_the_same_bits_another_does_not_and_the_global_generator_is_left_alone():
    before = torch.get_rng_state()
    (first, curve), (again, same), (other, _) = (trained(seed=s) for s in (1, 1, 2))
    assert torch.equal(before, torch.get_rng_state())
    assert np.array_equal(curve, same)
    assert all(torch.equal(v, again.state_dict()[k]) for k, v in first.state_dict().items())
    assert not torch.equal(first.mean.weight, other.mean.weight)


@pytest.mark.parametrize("label", [True, False])
def test_labels_that_never_vary_give_laplaces_constant_without_training(label):
    images, z_theta, valid = data()
    constant = np.full_like(valid, label)
    model, checkpoints = vae(1), Checkpoints([0])
    curve = fit(model, images, z_theta, constant, WEIGHTS["full"], SHORT, 1, checkpoints)
    assert not checkpoints.of(model)
    expected = 21 / 22 if label else 1 / 22  # 20 demonstrations
    np.testing.assert_allclose(model.probability(images, z_theta), expected, rtol=1e-5)
    assert torch.equal(model.mean.weight, vae(1).mean.weight)
    assert curve.shape == (1, 5) and curve[0, 4] == pytest.approx(-np.log(21 / 22))


def test_every_job_has_a_seed_of_its_own():
    seeds = {job_seed(s, u, n, v) for s in range(10) for u in ("careful", "normal") for n in (1, 9) for v in WEIGHTS}
    assert len(seeds) == 10 * 2 * 2 * 3
    assert job_seed(1, "careful") == job_seed(1, "careful") != job_seed("1c", "areful")
