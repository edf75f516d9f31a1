"""Repair: moving a path's z_theta up a specification's log-odds, so that its user accepts it."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray as Array
from torch import Tensor

from pipeline.spec.specification import Specification, to_tensor
from pipeline.table.bezier import Z_HIGH, Z_LOW

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

    def __post_init__(self):
        if self.optimiser not in OPTIMISERS:
            raise ValueError(f"repair.optimiser is {self.optimiser!r}: expected one of {', '.join(OPTIMISERS)}")
        for name in ("steps", "rate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"repair.{name} is {getattr(self, name)}: it must be positive")


@dataclass(frozen=True)
class Repairs:
    """Every step of every repair, the start first."""

    z: Float[Array, "scene start point 2"]  # step + 1 points [m], float32
    p: Float[Array, "scene start point"]  # P(valid) as the model sees it, float32


def repair(
    model: Specification,
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
    stepper = _Adam(z) if ascent.optimiser == "adam" else None
    path, log_odds = [z], []
    for step in range(ascent.steps):
        rate = ascent.rate * (1 - step / ascent.steps if ascent.settle else 1.0)
        value, delta = _slope(model, percept, z)
        if stepper is not None:
            move = stepper.direction(delta)
        elif ascent.optimiser == "normalised":
            move = delta / delta.norm(dim=-1, keepdim=True).clamp(min=torch.finfo(delta.dtype).tiny)
        else:
            move = delta
        z = (z + rate * move).clamp(Z_LOW, Z_HIGH)
        path.append(z)
        log_odds.append(value)
    with torch.no_grad():
        log_odds.append(model.logit(percept, z))
    return Repairs(torch.stack(path, dim=2).numpy(), torch.sigmoid(torch.stack(log_odds, dim=2)).numpy())


def _slope(model: Specification, percept: Tensor, z: Tensor) -> tuple[Tensor, Tensor]:
    """Log-odds of each path and their gradient in its z_theta; weights take none."""
    z = z.detach().requires_grad_()
    with torch.enable_grad():
        log_odds = model.logit(percept, z)
        if not log_odds.requires_grad:  # a model that ignores the path
            return log_odds, torch.zeros_like(z)
        (delta,) = torch.autograd.grad(log_odds.sum(), z)
    return log_odds.detach(), delta


class _Adam:
    """Adam's running moments (Kingma and Ba 2015, Algorithm 1), one pair per coordinate."""

    def __init__(self, z: Tensor, beta1: float = 0.9, beta2: float = 0.999):
        self.m, self.v = torch.zeros_like(z), torch.zeros_like(z)
        self.beta1, self.beta2, self.t = beta1, beta2, 0

    def direction(self, delta: Tensor) -> Tensor:
        """The step per unit of rate."""
        self.t += 1
        self.m = self.beta1 * self.m + (1 - self.beta1) * delta
        self.v = self.beta2 * self.v + (1 - self.beta2) * delta**2
        m, v = self.m / (1 - self.beta1**self.t), self.v / (1 - self.beta2**self.t)
        return m / (v.sqrt() + 1e-8)
