"""Fitting clearance models: each member maximises its own weighted likelihood of the labels, all at once."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from scipy.special import entr
from torch import Tensor, nn

from pipeline.models.base import to_tensor
from pipeline.models.clearance.clearance import NEEDED, ClearanceModel, clearance
from pipeline.training.loop import Checkpoints, Schedule, is_constant, padded, rule_of_succession, shares

CERTAIN = 1e4  # nats
BATCH_SIZE = 10  # models fitted together: what they compute still fits a processor's cache
CURVE = ("step", "total")  # columns of a learning curve


def fit(
    models: Sequence[ClearanceModel],
    images: Sequence[UInt8[Array, "scene 100 100 3"]],
    z_theta: Sequence[Float[Array, "scene _ 2"]],
    valid: Sequence[Bool[Array, "scene _"]],
    schedule: Schedule,
    seeds: Sequence[int],
    checkpoints: Checkpoints | None = None,
) -> list[Float[Array, "point 2"]]:
    """Train models of one kind in place, each on its demonstrations [m]; their learning curves (columns `CURVE`).

    Each member maximises its likelihood under weights of its own on the scenes, the Bayesian bootstrap's (Rubin, 1981).
    Demonstrations that never vary teach nothing: the model then answers Laplace's probability, whatever it sees.
    `checkpoints` keeps the weights on the way, each time with the evidence for them. All have as many scenes.
    """
    curves, training_sets = [np.array([[0.0, 0.0]])] * len(models), {}
    for i, (model, pictures, z, labels) in enumerate(zip(models, images, z_theta, valid, strict=True)):
        model.rate.fill_(rule_of_succession(labels))
        if is_constant(labels):
            model.evidence.fill_(-CERTAIN)
        else:
            training_sets[i] = _Lesson(model, look(model, pictures), z, labels, seeds[i])
    if training_sets:
        found = _ascend(list(training_sets.values()), schedule, checkpoints or Checkpoints())
        for i, curve in zip(training_sets, found, strict=True):
            curves[i] = curve
    return curves


@dataclass(frozen=True)
class _Lesson:
    """What one model is fitted to."""

    model: ClearanceModel
    percept: Float[Tensor, "scene thing 12"]
    z_theta: Float[Array, "scene n 2"]
    valid: Bool[Array, "scene n"]
    seed: int


def look(model: ClearanceModel, images: UInt8[Array, "scene 100 100 3"]) -> Float[Tensor, "scene thing 12"]:
    """What stands in the training scenes; the model's features are measured against theirs from now on."""
    percept = model.perceive(to_tensor(images))
    present = percept[..., -1] > 0
    if present.sum() > 1:
        features = percept[present][:, 5:-1]
        model.centre.copy_(features.mean(0))
        model.spread.copy_(features.std(0).clamp(min=1e-3))
    return percept


@torch.no_grad()
def _weigh(training_set: _Lesson) -> None:
    """Set the evidence that things matter: what the labels gain in likelihood over one rate for every path."""
    model, valid = training_set.model, torch.tensor(training_set.valid)
    model.evidence.fill_(CERTAIN)  # what the members say by themselves
    logit = model.logit(training_set.percept, torch.tensor(training_set.z_theta).float())
    surprise = F.binary_cross_entropy_with_logits(logit, valid.float(), reduction="sum")
    rate = float(valid.float().mean())
    model.evidence.fill_(valid.numel() * (entr(rate) + entr(1 - rate)) - float(surprise) - NEEDED)


def _ascend(
    training_sets: list[_Lesson], schedule: Schedule, checkpoints: Checkpoints
) -> list[Float[Array, "point 2"]]:
    """Every model's and member's ascent of its likelihood, all at once: ten models cost what four do by themselves."""
    models, percept = (
        [training_set.model for training_set in training_sets],
        torch.stack([training_set.percept for training_set in training_sets]),
    )
    together, n = _together(models), [training_set.valid.shape[1] for training_set in training_sets]
    paths, labels = (
        padded(of)
        for of in zip(*((training_set.z_theta, training_set.valid) for training_set in training_sets), strict=True)
    )
    near = [clearance(p, torch.tensor(z).float()) for p, z in zip(percept, paths, strict=True)]
    most = max(c.shape[-1] for c in near)
    clearances = torch.stack([F.pad(c, (0, most - c.shape[-1])) for c in near])  # (model, scene, row, thing)
    valid = torch.tensor(np.stack(labels))[:, None]
    share = torch.from_numpy(shares(n).T).float()[:, None, None] * torch.stack(
        [bootstrap(training_set.model, len(training_set.valid), training_set.seed) for training_set in training_sets]
    )  # (model, member, scene, row)
    optimiser, cycle = schedule.optimiser([p for p in together.parameters() if p.requires_grad])
    curve = []
    for step in range(schedule.steps):
        if step in checkpoints.steps:
            _hand_over(together, training_sets)
            checkpoints.keep(step, *models)
        log_valid = together.log_valid(percept, clearances).clamp(max=-1e-6)
        surprise = -torch.where(valid, log_valid, torch.log(-torch.expm1(log_valid)))
        loss = (share * surprise).sum(-1).mean(-1)  # (model, member)
        optimiser.zero_grad()
        loss.sum().backward()
        optimiser.step()
        cycle.step()
        if step % schedule.curve_every == 0 or step == schedule.steps - 1:
            curve.append((np.full(len(models), step), loss.mean(-1).detach().numpy()))
    _hand_over(together, training_sets)
    return list(np.array(curve, float).transpose(2, 0, 1))


def _together(models: list[ClearanceModel]) -> ClearanceModel:
    """One whose parameters and buffers have a first axis for the models."""
    together = copy.deepcopy(models[0])
    for name, parameter in models[0].named_parameters():
        stacked = torch.stack([model.get_parameter(name).detach() for model in models])
        setattr(together, name, nn.Parameter(stacked, requires_grad=parameter.requires_grad))
    for name, _ in models[0].named_buffers():
        setattr(together, name, torch.stack([model.get_buffer(name) for model in models]))
    return together


@torch.no_grad()
def _hand_over(together: ClearanceModel, training_sets: list[_Lesson]) -> None:
    """Give every model its weights, and the evidence for them."""
    for name, parameter in together.named_parameters():
        for training_set, own in zip(training_sets, parameter, strict=True):
            training_set.model.get_parameter(name).copy_(own)
    for training_set in training_sets:
        _weigh(training_set)


def bootstrap(model: ClearanceModel, scenes: int, seed: int) -> Float[Tensor, "member scene 1"]:
    """How much each scene counts for each member."""
    return torch.empty(len(model.margin), scenes, 1).exponential_(generator=torch.Generator().manual_seed(seed))
