"""Facts about Eq. 1: its terms, their reductions and their gradients."""

import pytest
import torch
from torch.distributions import Normal, kl_divergence

from pipeline.models.vae import losses
from pipeline.models.vae.losses import equation_1
from tests.factories import WEIGHTS, vae

SCENES, PATHS = 3, 4


def test_each_term_has_the_closed_form_and_the_reduction_of_equation_1():
    mean, log_variance = torch.randn(2, 5, 15, generator=torch.Generator().manual_seed(1)).double()
    expected = kl_divergence(Normal(mean, (0.5 * log_variance).exp()), Normal(0.0, 1.0)).sum(-1).mean()
    torch.testing.assert_close(losses.kl(mean, log_variance), expected)
    images = torch.zeros(2, 3, 4, 4)
    decoded = images.clone()
    decoded[0, 1, 2, 3] = 0.5
    assert losses.reconstruction(decoded, images).item() == pytest.approx(0.25 / images.numel())
    logits, valid = torch.zeros(2, 7), torch.ones(2, 7, dtype=torch.bool)
    assert losses.classification(logits, valid).item() == pytest.approx(0.6931472)


@pytest.mark.parametrize("variant", WEIGHTS)
def test_sharing_a_scenes_encoding_changes_neither_loss_nor_gradient(variant):
    """With biases other than 0, where a rectifier whose inputs are all closed stands on its kink."""
    model, g = vae(3).double(), torch.Generator().manual_seed(5)
    for name, parameter in model.named_parameters():
        if name.endswith("bias"):
            parameter.detach().normal_(std=0.1, generator=g)
    images = torch.rand(SCENES, 3, 100, 100, generator=g, dtype=torch.double)
    z_theta = torch.rand(SCENES, PATHS, 2, generator=g, dtype=torch.double) * 1.4 - 0.2
    valid = torch.rand(SCENES, PATHS, generator=g) < 0.5
    noise = torch.randn(SCENES, 15, generator=g, dtype=torch.double)
    shared = equation_1(model, images, z_theta, valid, WEIGHTS[variant], noise)
    shared.total.backward()
    gradient = {name: p.grad.clone() for name, p in model.named_parameters() if p.grad is not None}
    model.zero_grad()
    rows = equation_1(  # one row per (image, trajectory): every image and its noise repeated for each path
        model, images.repeat_interleave(PATHS, 0), z_theta.reshape(-1, 1, 2), valid.reshape(-1, 1),
        WEIGHTS[variant], noise.repeat_interleave(PATHS, 0),
    )  # fmt: skip
    rows.total.backward()
    for ours, theirs in zip(shared, rows, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-12, atol=1e-14)
    for name, expected in gradient.items():
        torch.testing.assert_close(model.get_parameter(name).grad, expected, rtol=1e-9, atol=1e-13)
