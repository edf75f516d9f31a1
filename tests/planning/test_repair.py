"""Gradient repair climbs models whose shape is known."""

import numpy as np
import pytest
import torch

from pipeline.planning.repair import Ascent, repair
from pipeline.world.bezier import random_z_theta
from tests.planning.hills import Hill

IMAGES = np.zeros((3, 100, 100, 3), dtype=np.uint8)
STARTS = random_z_theta(np.random.default_rng(0), 3, 20)


@pytest.mark.parametrize(
    ("name", "rate", "theirs", "atol"),
    [("gradient", 0.02, torch.optim.SGD, 1e-6), ("adam", 0.05, torch.optim.Adam, 1e-5)],
)
def test_every_step_is_that_of_torch_s_optimiser_on_the_log_odds_and_the_last_is_at_the_peak(name, rate, theirs, atol):
    repairs = repair(Hill(), IMAGES, STARTS, Ascent(steps=60, optimiser=name, rate=rate))
    z = torch.from_numpy(STARTS.astype(np.float32))
    np.testing.assert_array_equal(repairs.z[:, :, 0], z)
    optimiser = theirs([z], lr=rate, maximize=True)
    for step in range(60):
        np.testing.assert_allclose(repairs.z[:, :, step], z.numpy(), atol=atol)
        optimiser.param_groups[0]["lr"] = rate * (1 - step / 60)
        z.grad = -32 * (z - torch.tensor([0.3, 0.8]))  # of the hill's log-odds
        optimiser.step()
        z.clamp_(-0.2, 1.2)
    assert repairs.z.shape == (3, 20, 61, 2) and np.abs(repairs.z[:, :, -1] - [0.3, 0.8]).max() < 0.05
    assert (repairs.p[:, :, -1] > 0.98).all()
