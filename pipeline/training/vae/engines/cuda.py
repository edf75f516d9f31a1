"""Fits several users' models at once on any torch device: `training.fit` vectorised over models by torch.func.vmap.

As in a stack (pipeline.training.vae.engines.simd) the models share their weights of Eq. 1, number of scenes and schedule, and each
draws its noise on the CPU as the reference does. Sums are taken in an order that the device and the batch decide, so
trained weights differ from the other engines', and a little from batch to batch, by amplified rounding.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from torch import nn
from torch.func import functional_call, stack_module_state, vmap

from pipeline.models.base import to_tensor
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Terms, Weights, equation_1
from pipeline.training.loop import Checkpoints, Schedule, padded, shares
from pipeline.training.vae.engines.reference import fit_varied

BATCH_SIZE = 128  # models: about 4 GB of activations in the paper's size


class _Loss(nn.Module):
    """Eq. 1 as what a module computes: `functional_call` lends weights to that alone."""

    def __init__(self, model: BetaVae, weights: Weights):
        super().__init__()
        self.model, self.weights = model, weights

    def forward(self, images, z_theta, valid, noise, share) -> Terms:
        return equation_1(self.model, images, z_theta, valid, self.weights, noise, share)


def device() -> torch.device:
    """CUDA's, if there is one."""
    return torch.device("cuda" if torch.cuda.is_available() else "cpu")


def fit_batch(
    models: Sequence[BetaVae],
    images: Sequence[UInt8[Array, "scene 100 100 3"]],
    z_theta: Sequence[Float[Array, "scene _ 2"]],
    valid: Sequence[Bool[Array, "scene _"]],
    weights: Weights,
    schedule: Schedule,
    seeds: Sequence[int],
    checkpoints: Checkpoints | None = None,
) -> list[Float[Array, "point 5"]]:
    """Train models in place on `device()`, each on its demonstrations [m]; their learning curves (`CURVE`).

    Model by model what `training.fit` does, which also sees to demonstrations that are all valid or all invalid.
    """
    with torch.backends.cudnn.flags(enabled=True, deterministic=True, allow_tf32=False):
        return fit_varied(_descend, models, images, z_theta, valid, weights, schedule, seeds, checkpoints)


def _descend(models, images, z_theta, valid, weights, schedule, seeds, checkpoints) -> list[Float[Array, "point 5"]]:
    """The gradient descent of all models; a point of a curve is the loss before that many updates."""

    def stacked(tensors: Sequence[torch.Tensor]) -> torch.Tensor:
        return torch.stack(list(tensors)).to(device(), models[0].mean.weight.dtype)  # (model, ...)

    x = stacked([to_tensor(of_model) for of_model in images])
    z, labels = (stacked([torch.from_numpy(of_model) for of_model in padded(demos)]) for demos in (z_theta, valid))
    share = stacked(torch.from_numpy(shares([of_model.shape[1] for of_model in valid])).unbind(1))
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]
    loss = _Loss(models[0], weights)
    drawn, _ = stack_module_state([_Loss(model, weights) for model in models])
    parameters = {name: value.detach().to(device()).requires_grad_() for name, value in drawn.items()}
    optimiser, cycle = schedule.optimiser(parameters.values())
    losses = vmap(lambda own, *data: functional_call(loss, own, data))
    curve = []
    for step in range(schedule.steps):
        if step in checkpoints.steps:
            _hand_over(parameters, models)
            checkpoints.keep(step, *models)
        noise = stacked([torch.randn(x.shape[1], models[0].latent, generator=generator) for generator in generators])
        terms = losses(parameters, x, z, labels, noise, share)  # (model) each
        optimiser.zero_grad()
        terms.total.sum().backward()
        optimiser.step()
        cycle.step()
        if step % schedule.curve_every == 0 or step == schedule.steps - 1:
            point = torch.stack([*terms, terms.total]).detach()  # (term, model)
            curve.append((step, point))

    _hand_over(parameters, models)
    for model in models:
        model.eval()
    steps = np.array([step for step, _ in curve], float)
    points = torch.stack([point for _, point in curve]).double().cpu().numpy()  # (point, term, model)
    return [np.column_stack([steps, points[..., i]]) for i in range(len(models))]


@torch.no_grad()
def _hand_over(parameters: Mapping[str, torch.Tensor], models: Sequence[BetaVae]) -> None:
    """Give each model its own of the stacked weights."""
    for name, value in parameters.items():
        for model, own in zip(models, value.unbind(), strict=True):
            model.get_parameter(name.removeprefix("model.")).copy_(own)
