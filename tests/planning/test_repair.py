"""Gradient repair climbs models whose shape is known."""

import numpy as np
import pytest
import torch

from pipeline.planning.repair import Ascent, repair
from pipeline.world.bezier import random_z_theta
from tests.planning.hills import Hill

IMAGES = np.zeros((3, 100, 100, 3), dtype=np.uint8)
STARTS = random_z_theta(np.random.default_rng(0), 3, 20)
RATES = {"gradient": 0.02, "adam": 0.05}


def ascent(optimiser: str, steps: int = 60) -> Ascent:
    return Ascent(steps=steps, optimiser=optimiser, rate=RATES[optimiser])


@pytest.mark.parametrize("optimiser", RATES)
def test_every_optimiser_climbs_to_the_peak(optimiser: str):
    repairs = repair(Hill(), IMAGES, STARTS, ascent(optimiser))
    assert np.abs(repairs.z[:, :, -1] - [0.3, 0.8]).max() < 0.05
    assert (repairs.p[:, :, -1] > 0.98).all()
    assert repairs.z.shape == (3, 20, 61, 2)
    np.testing.assert_array_equal(repairs.z[:, :, 0], STARTS.astype(np.float32))


def test_the_plain_step_is_the_rate_times_the_gradient_of_the_log_odds():
    repairs = repair(Hill(), IMAGES, STARTS, ascent("gradient", steps=1))
    expected = STARTS - 0.02 * 32 * (STARTS - [0.3, 0.8])
    np.testing.assert_allclose(repairs.z[:, :, 1], expected.clip(-0.2, 1.2), atol=1e-6)


def test_adam_takes_the_steps_of_torch_s_adam():
    ours = repair(Hill(), IMAGES, STARTS, ascent("adam", steps=20))
    z = torch.from_numpy(STARTS.astype(np.float32))
    optimiser = torch.optim.Adam([z], lr=RATES["adam"], maximize=True)
    for step in range(20):
        np.testing.assert_allclose(ours.z[:, :, step], z.numpy(), atol=1e-5)
        optimiser.param_groups[0]["lr"] = RATES["adam"] * (1 - step / 20)
        z.grad = -32 * (z - torch.tensor([0.3, 0.8]))  # of the hill's log-odds
        optimiser.step()
        z.clamp_(-0.2, 1.2)
