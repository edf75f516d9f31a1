"""Fits one user's model to its labelled demonstrations by full-batch gradient descent on Eq. 1."""

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from torch import Tensor, nn
from torch.optim import AdamW
from torch.optim.lr_scheduler import OneCycleLR

from pipeline.spec.losses import Terms, Weights, equation_1
from pipeline.spec.specification import to_tensor
from pipeline.spec.vae import VaeSpecification

CURVE = ("step", "reconstruction", "kl", "classification", "total")  # columns of a learning curve


@dataclass(frozen=True)
class Schedule:
    """How long and how fast (conf/train, conf/path; conf/irl has more)."""

    steps: int  # one of the VAE's sees every demonstration once
    rate: float  # AdamW's peak learning rate; OneCycle warms up to it and anneals to nearly 0
    weight_decay: float
    curve_every: int  # steps between two points of the learning curve

    def __post_init__(self):
        require_positive(self, "steps", "rate", "curve_every")
        if not self.weight_decay >= 0:
            raise ValueError(
                f"weight_decay is {self.weight_decay}: it must be 0 or more (conf/train, conf/irl, conf/path)"
            )

    def optimiser(self, parameters: Iterable[Tensor]) -> tuple[AdamW, OneCycleLR]:
        """AdamW of `parameters`, and what paces it: both take a step after every gradient."""
        optimiser = AdamW(parameters, lr=self.rate, weight_decay=self.weight_decay, fused=True)
        return optimiser, OneCycleLR(optimiser, self.rate, total_steps=self.steps)


def require_positive(schedule: Schedule, *names: str) -> None:
    """ValueError for the first of these fields that is not above 0."""
    for name in names:
        if not getattr(schedule, name) > 0:
            raise ValueError(
                f"{name} is {getattr(schedule, name)}: it must be positive (conf/train, conf/irl, conf/path, variants)"
            )


class Checkpoints:
    """Weights of models as they were at some steps of their training, before that step's update."""

    def __init__(self, steps: Iterable[int] = ()):
        self.steps = frozenset(steps)
        self._states: list[tuple[nn.Module, int, dict[str, Array]]] = []

    def keep(self, step: int, *models: nn.Module) -> None:
        """Keep a copy of the models' parameters and buffers."""
        for model in models:
            state = {name: value.detach().cpu().numpy().copy() for name, value in model.state_dict().items()}
            self._states.append((model, step, state))

    def of(self, model: nn.Module) -> dict[int, dict[str, Array]]:
        """step -> the model's weights by name."""
        return {step: state for whose, step, state in self._states if whose is model}


def job_seed(*names: str | int) -> int:
    """A 63-bit seed of its own for each job, from what names it: e.g. (seed, user, n, variant)."""
    digest = hashlib.sha256("/".join(map(str, names)).encode()).digest()
    return int.from_bytes(digest[:8], "big") >> 1


def never_varies(valid: Bool[Array, "*demo"]) -> bool:
    """Whether demonstrations are all valid or all invalid: they say nothing about what changes validity."""
    return bool(valid.all() or not valid.any())


def laplace(valid: Bool[Array, "*demo"]) -> float:
    """Laplace's rule of succession: P(the next path is valid) = (valid + 1) / (all + 2)."""
    return (int(valid.sum()) + 1) / (valid.size + 2)


def fit(
    model: VaeSpecification,
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
    if never_varies(valid):
        model.set_constant_head(laplace(valid))
        model.eval()
        loss = weights.gamma * -np.log(max(laplace(valid), 1 - laplace(valid)))
        return np.array([[0, 0, 0, loss, loss]])
    return _descend(model, images, z_theta, valid, weights, schedule, seed, checkpoints or Checkpoints())


def fit_varied(
    descend, models, images, z_theta, valid, weights, schedule, seeds, checkpoints
) -> list[Float[Array, "point 5"]]:
    """`fit` of several models by one `descend`, with its arguments, but for those whose labels never vary."""
    jobs = list(zip(models, images, z_theta, valid, seeds, strict=True))
    varied = [i for i, labels in enumerate(valid) if not never_varies(labels)]
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


def padded(demos: Sequence[Array]) -> list[Array]:
    """Demonstrations (scene, n, ...) of several models in as many rows: a scene's first one again in those to spare."""
    rows = max(of_model.shape[1] for of_model in demos)
    return [np.concatenate([d, d[:, :1].repeat(rows - d.shape[1], 1)], 1) for d in demos]


def shares(n: Sequence[int]) -> Float[Array, "row model"]:
    """What each row of `padded` demonstrations counts in its scene's mean: 1 / n, or 0 to spare."""
    return np.where(np.arange(max(n))[:, None] < n, 1 / np.array(n), 0)


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
