"""Fit models by torch's gradient of Eq. 1 on any device, all models of a batch at once under torch.func.vmap.

The models share the weights of Eq. 1, the number of scenes and the schedule. Noise is drawn on the CPU. Device and
batch size change the order of sums, so trained weights differ by amplified rounding.
"""

from collections.abc import Sequence
from functools import partial

import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from torch import nn
from torch.func import functional_call, stack_module_state, vmap

from pipeline.models.base import to_tensor
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Terms, Weights, equation_1
from pipeline.training.loop import (
    Checkpoints,
    Losses,
    Schedule,
    minimise,
    pad_demonstrations,
    row_weights,
    unstack_models,
)
from pipeline.training.vae.engines import fit_varied


def fit_batch(
    models: Sequence[BetaVae],
    images: Sequence[UInt8[Array, "scene 100 100 3"]],
    z_theta: Sequence[Float[Array, "scene _ 2"]],
    valid: Sequence[Bool[Array, "scene _"]],
    weights: Weights,
    schedule: Schedule,
    seeds: Sequence[int],
    checkpoints: Checkpoints | None = None,
    device: str = "cpu",
) -> list[Float[Array, "point 5"]]:
    """Train models in place, each on its demonstrations [m]; return their learning curves (`CURVE`).

    `seeds` draw the latent noise; torch's global generator is unchanged. `checkpoints` keeps intermediate weights.
    Constant labels: see `fit_varied`.
    """

    descend = partial(_descend, device=torch.device(device))
    with torch.backends.cudnn.flags(enabled=True, deterministic=True, allow_tf32=False):
        return fit_varied(descend, models, images, z_theta, valid, weights, schedule, seeds, checkpoints)


class _Loss(nn.Module):
    """Eq. 1 as the output of a module, since `functional_call` needs a module."""

    def __init__(self, model: BetaVae, weights: Weights):
        super().__init__()
        self.model, self.weights = model, weights

    def forward(self, images, z_theta, valid, noise, share) -> Terms:
        return equation_1(self.model, images, z_theta, valid, self.weights, noise, share)


def _descend(
    models, images, z_theta, valid, weights, schedule, seeds, checkpoints, device
) -> list[Float[Array, "point 5"]]:
    """Train all models at once."""

    def stacked(tensors: Sequence[torch.Tensor]) -> torch.Tensor:
        return torch.stack(list(tensors)).to(device, models[0].mean.weight.dtype)  # (model, ...)

    x = stacked([to_tensor(of_model) for of_model in images])
    z, labels = (
        stacked([torch.from_numpy(of_model) for of_model in pad_demonstrations(demos)]) for demos in (z_theta, valid)
    )
    share = stacked(torch.from_numpy(row_weights([of_model.shape[1] for of_model in valid])).unbind(1))
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]
    loss_of_model = _Loss(models[0], weights)
    drawn, buffers = stack_module_state(list(models))
    parameters = {name: value.detach().to(device).requires_grad_() for name, value in drawn.items()}
    fixed = {name: value.to(device) for name, value in buffers.items()}
    named = {f"model.{name}": value for name, value in (parameters | fixed).items()}  # with the names inside `_Loss`
    losses = vmap(lambda weights_of_model, *data: functional_call(loss_of_model, weights_of_model, data))

    def loss() -> Losses:
        noise = stacked([torch.randn(x.shape[1], models[0].latent, generator=generator) for generator in generators])
        terms = losses(named, x, z, labels, noise, share)  # (model,) each
        return terms.total.sum(), [*terms, terms.total]

    def hand_over() -> None:
        unstack_models(parameters, models)

    curve = minimise(loss, parameters.values(), schedule, before_step=checkpoints.before_step(models, hand_over))
    hand_over()
    return list(curve.transpose(2, 0, 1))
