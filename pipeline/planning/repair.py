"""Repair: moving a path's z_theta up a specification's log-odds, so that its user accepts it."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray as Array
from torch import Tensor
from torch.optim import SGD, Adam
from torch.optim.lr_scheduler import LambdaLR

from pipeline.models.base import ValidityModel, to_tensor
from pipeline.world.bezier import Z_HIGH, Z_LOW

OPTIMISERS = ("gradient", "normalised", "adam")


@dataclass(frozen=True)
class Ascent:
    """How z_theta climbs (conf/repair).

    `gradient` moves by rate x Delta [m^2 per unit of log-odds], the paper's plain step; `normalised` by rate
    [m] along Delta, whatever its size; `adam` by Adam's steps of about rate [m] per coordinate. The rate falls
    linearly to zero over the steps if `settle`.
    """

    steps: int
    optimiser: str
    rate: float
    settle: bool


@dataclass(frozen=True)
class Repairs:
    """Every step of every repair, the start first."""

    z: Float[Array, "scene start point 2"]  # step + 1 points [m], float32
    p: Float[Array, "scene start point"]  # P(valid) as the model sees it, float32


def repair(
    model: ValidityModel,
    images: UInt8[Array, "scene 100 100 3"],
    starts: Float[Array, "scene start 2"],
    ascent: Ascent,
) -> Repairs:
    """Take `ascent.steps` steps from every start [m] along Delta = d log-odds(v = 1) / d z_theta.

    The paper's Delta (Section "Problem Formulation") is of C_s itself; log-odds point the same way and do not
    flatten where p is near 0 or 1. A step is cut off at the edge of the z_theta square. Each scene is perceived
    once, and no start sees another.
    """
    model.eval()
    with torch.no_grad():
        percept = model.perceive(to_tensor(images))
    z = torch.as_tensor(np.asarray(starts, dtype=np.float32)).clamp(Z_LOW, Z_HIGH)
    optimiser = (Adam if ascent.optimiser == "adam" else SGD)([z], lr=ascent.rate, maximize=True)
    pace = LambdaLR(optimiser, lambda step: 1 - step / ascent.steps if ascent.settle else 1.0)
    path, log_odds = [z.clone()], []
    for _ in range(ascent.steps):
        value, delta = _slope(model, percept, z)
        if ascent.optimiser == "normalised":
            delta = delta / delta.norm(dim=-1, keepdim=True).clamp(min=torch.finfo(delta.dtype).tiny)
        z.grad = delta
        optimiser.step()
        pace.step()
        z.clamp_(Z_LOW, Z_HIGH)
        path.append(z.clone())
        log_odds.append(value)
    with torch.no_grad():
        log_odds.append(model.logit(percept, z))
    return Repairs(torch.stack(path, dim=2).numpy(), torch.sigmoid(torch.stack(log_odds, dim=2)).numpy())


def _slope(model: ValidityModel, percept: Tensor, z: Tensor) -> tuple[Tensor, Tensor]:
    """Log-odds of each path and their gradient in its z_theta; weights take none."""
    z = z.detach().requires_grad_()
    with torch.enable_grad():
        log_odds = model.logit(percept, z)
        if not log_odds.requires_grad:  # a model that ignores the path
            return log_odds, torch.zeros_like(z)
        (delta,) = torch.autograd.grad(log_odds.sum(), z)
    return log_odds.detach(), delta
