"""The surrogate is a Gaussian process that is told slopes: as scikit-learn's that is told the values close by."""

import numpy as np
import torch
from scipy.stats import t
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import Matern

from pipeline.spec import surrogate
from pipeline.spec.surrogate import HIGHEST, LENGTH, OPTIMISM, SCALE, Surrogate, depth

CLOSE = 1e-4  # metres


def wavy(z: torch.Tensor) -> torch.Tensor:
    """Log-odds between -2 and 2."""
    return 2 * torch.sin(5 * z[..., 0]) * torch.cos(3 * z[..., 1] + z[..., 0])


def asked(z: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Log-odds of paths and their slopes."""
    z = z.clone().requires_grad_()
    logit = wavy(z)
    (slope,) = torch.autograd.grad(logit.sum(), z)
    return logit.detach(), slope


def drawn(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, 2, generator=torch.Generator().manual_seed(0))


def test_a_depth_is_the_quantile_of_students_t_that_has_the_probability():
    logit = torch.linspace(-6, 1.5, 20, dtype=torch.float64)
    np.testing.assert_allclose(depth(logit), t.ppf(logit.sigmoid(), 2) / 2**0.5, rtol=1e-9)


def test_its_bounds_are_those_of_scikit_learn_told_values_in_place_of_slopes(monkeypatch):
    monkeypatch.setattr(surrogate, "NOISE", 1e-7)
    z, where = drawn(5).double(), drawn(40).double()[5:]
    near = torch.cat([z, *(z + CLOSE * axis for axis in torch.eye(2).double())])
    other = GaussianProcessRegressor(Matern(LENGTH, "fixed", 2.5), alpha=1e-12, optimizer=None)
    mean, spread = other.fit(near, depth(wavy(near)) / SCALE).predict(where.numpy(), return_std=True)
    expected = (SCALE * (mean + OPTIMISM * spread)).clip(max=HIGHEST)

    mine = Surrogate()
    mine.learn(z, *asked(z))
    np.testing.assert_allclose(depth(mine.bound(where)), expected, atol=5e-3)


def test_it_believes_what_it_was_told():
    z = drawn(3, 8)
    mine = Surrogate()
    mine.learn(z, *asked(z))
    logit, _ = asked(z)
    believed = mine.bound(z)
    assert (believed >= logit - 0.05).all()  # an upper bound
    assert (believed <= logit + 0.35).all()  # and hardly above: a share NOISE of the variance is believed of none


def test_what_is_learned_at_once_and_bit_by_bit_is_the_same():
    z, where = drawn(2, 9), drawn(2, 20)
    at_once, by_and_by = Surrogate(), Surrogate()
    at_once.learn(z, *asked(z))
    for part in z.split(4, dim=1):
        by_and_by.learn(part, *asked(part))
    torch.testing.assert_close(at_once.bound(where), by_and_by.bound(where))


def test_far_from_what_it_knows_it_is_as_unsure_as_at_first():
    mine = Surrogate()
    z = torch.zeros(1, 1, 2)
    mine.learn(z, torch.tensor([[-3.0]]), torch.zeros(1, 1, 2))
    far = mine.bound(torch.full((1, 1, 2), 20.0))
    torch.testing.assert_close(far, 2 * torch.asinh(torch.tensor([[min(SCALE * OPTIMISM, HIGHEST)]])))


def test_answers_beyond_all_doubt_have_no_slope_and_no_infinity():
    mine = Surrogate()
    z = drawn(1, 6)
    logit = torch.tensor([[-400.0, -30.0, 0.0, 5.0, 60.0, 400.0]])
    mine.learn(z, logit, torch.full((1, 6, 2), 1e3))
    assert mine.bound(drawn(1, 30)).isfinite().all()
