"""Fit one user's model to its labelled demonstrations by full-batch gradient descent on Eq. 1."""

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array

from pipeline.models.base import to_tensor
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights, equation_1
from pipeline.training.loop import Checkpoints, Losses, Schedule, is_constant, minimise, rule_of_succession

CURVE = ("step", "reconstruction", "kl", "classification", "total")  # columns of a learning curve


def fit(
    model: BetaVae,
    images: UInt8[Array, "scene 100 100 3"],
    z_theta: Float[Array, "scene n 2"],
    valid: Bool[Array, "scene n"],
    weights: Weights,
    schedule: Schedule,
    seed: int,
    checkpoints: Checkpoints | None = None,
) -> Float[Array, "point 5"]:
    """Train `model` in place on n demonstrations [m] per scene; return the learning curve (`CURVE`).

    If all labels are equal, the encoder stays untrained and the classifier answers Laplace's probability for every
    input.
    `seed` draws the latent noise; torch's global generator is unchanged. `checkpoints` keeps intermediate weights.
    """
    model.standardise(images)
    if is_constant(valid):
        probability = rule_of_succession(valid)
        model.set_constant_head(probability)
        model.eval()
        loss = weights.gamma * -np.log(max(probability, 1 - probability))
        return np.array([[0, 0, 0, loss, loss]])
    return _descend(model, images, z_theta, valid, weights, schedule, seed, checkpoints or Checkpoints())


def fit_varied(
    fit_stack, models, images, z_theta, valid, weights, schedule, seeds, checkpoints
) -> list[Float[Array, "point 5"]]:
    """Fit models with varying labels by one call of `fit_stack` and the others by `fit`; return all curves in order."""
    jobs = list(zip(models, images, z_theta, valid, seeds, strict=True))
    varied = [i for i, labels in enumerate(valid) if not is_constant(labels)]
    curves = {
        i: fit(*job, weights=weights, schedule=schedule, seed=seed)
        for i, (*job, seed) in enumerate(jobs)
        if i not in varied
    }
    if varied:
        for i in varied:
            models[i].standardise(images[i])
        *data, varied_seeds = zip(*(jobs[i] for i in varied), strict=True)
        varied_curves = fit_stack(*data, weights, schedule, varied_seeds, checkpoints or Checkpoints())
        curves |= zip(varied, varied_curves, strict=True)
    return [curves[i] for i in range(len(jobs))]


def _descend(model, images, z_theta, valid, weights, schedule, seed, checkpoints) -> Float[Array, "point 5"]:
    """Train one model whose labels vary."""
    x = to_tensor(images)
    z = torch.from_numpy(z_theta.astype(np.float32))  # (scene, n, 2)
    labels = torch.from_numpy(valid.astype(np.float32))  # (scene, n)
    generator = torch.Generator().manual_seed(seed)

    def loss() -> Losses:
        noise = torch.randn(len(x), model.latent, generator=generator)
        terms = equation_1(model, x, z, labels, weights, noise)
        return terms.total, [*terms, terms.total]

    model.train()
    curve = minimise(loss, model.parameters(), schedule, before_step=checkpoints.before_step([model]))
    model.eval()
    return curve
