"""Fits one user's model to its labelled demonstrations by full-batch gradient descent on Eq. 1."""

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array

from pipeline.models.base import to_tensor
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Terms, Weights, equation_1
from pipeline.training.loop import Checkpoints, Schedule, is_constant, rule_of_succession

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
    """Train `model` in place on n demonstrations [m] a scene; returns the learning curve (`CURVE`).

    Where the demonstrations never vary, the model keeps its untrained encoder and gets a constant head instead, at
    Laplace's probability.
    `seed` draws the latent noise; torch's global generator is left alone. `checkpoints` keeps the weights on the way.
    """
    if is_constant(valid):
        model.set_constant_head(rule_of_succession(valid))
        model.eval()
        loss = weights.gamma * -np.log(max(rule_of_succession(valid), 1 - rule_of_succession(valid)))
        return np.array([[0, 0, 0, loss, loss]])
    return _descend(model, images, z_theta, valid, weights, schedule, seed, checkpoints or Checkpoints())


def fit_varied(
    descend, models, images, z_theta, valid, weights, schedule, seeds, checkpoints
) -> list[Float[Array, "point 5"]]:
    """`fit` of several models by one `descend`, with its arguments, but for those whose labels never vary."""
    jobs = list(zip(models, images, z_theta, valid, seeds, strict=True))
    varied = [i for i, labels in enumerate(valid) if not is_constant(labels)]
    curves = {
        i: fit(*job, weights=weights, schedule=schedule, seed=seed)
        for i, (*job, seed) in enumerate(jobs)
        if i not in varied
    }
    if varied:
        *of_varied, own_seeds = zip(*(jobs[i] for i in varied), strict=True)
        found = descend(*of_varied, weights, schedule, own_seeds, checkpoints or Checkpoints())
        curves |= zip(varied, found, strict=True)
    return [curves[i] for i in range(len(jobs))]


def _descend(model, images, z_theta, valid, weights, schedule, seed, checkpoints) -> Float[Array, "point 5"]:
    """The gradient descent itself; a point of the curve is the loss before that many updates."""
    x = to_tensor(images)
    z = torch.from_numpy(z_theta.astype(np.float32))  # (scene, n, 2)
    labels = torch.from_numpy(valid.astype(np.float32))  # (scene, n)
    generator = torch.Generator().manual_seed(seed)
    optimiser, cycle = schedule.optimiser(model.parameters())
    curve: list[tuple[int, Terms]] = []
    model.train()
    for step in range(schedule.steps):
        if step in checkpoints.steps:
            checkpoints.keep(step, model)
        noise = torch.randn(len(x), model.latent, generator=generator)
        terms = equation_1(model, x, z, labels, weights, noise)
        optimiser.zero_grad()
        terms.total.backward()
        optimiser.step()
        cycle.step()
        if step % schedule.curve_every == 0 or step == schedule.steps - 1:
            curve.append((step, Terms(*(term.detach() for term in terms))))
    model.eval()
    return np.array([[step, *map(float, terms), float(terms.total)] for step, terms in curve])
