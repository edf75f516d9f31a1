"""Repair paths by gradient ascent on a model's log-odds of validity (paper, "Trajectory Backpropagation")."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor

from pipeline.models.base import Images, ValidityModel
from pipeline.models.curves import resample
from pipeline.perception.objects import Objects
from pipeline.planning.bumps import POINTS, basis
from pipeline.runtime.roots import square_root
from pipeline.runtime.settings import Count, Group, Size
from pipeline.world.bezier import Z_HIGH, Z_LOW

Starts = Float[Array, "scene start 2"] | Float[Array, "scene start point 2"]  # z_theta, or points of curves [m]
DECAY, SQUARES_DECAY, EPSILON = 0.9, 0.999, 1e-8  # beta_1, beta_2 and epsilon of Adam (Kingma and Ba, 2015)


class Ascent(Group):
    """Settings of gradient ascent (conf/repair.yaml).

    optimiser: `gradient` steps by rate * Delta, as in the paper (rate in m^2 per unit of log-odds); `adam` takes
    Adam's steps of about rate [m] per coordinate. The rate decreases linearly to zero over the steps.
    """

    steps: Count
    optimiser: Literal["gradient", "adam"]
    rate: Size


@dataclass(frozen=True)
class Repairs:
    """All steps of all repairs, including the start; of curves, `z` holds the offsets (point, offset, 2)."""

    z: Float[Array, "scene start point *offset 2"]  # start and all steps [m], float32
    p: Float[Array, "scene start point"]  # P(valid) by the model at these points, float32


def repair(
    model: ValidityModel, images: Images | Objects, starts: Starts, ascent: Ascent, free_ends: bool = False
) -> Repairs:
    """Take `ascent.steps` steps from each start [m] along Delta = d log-odds(v = 1) / d z_theta; return all points.

    The paper's Delta (Section "Problem Formulation") is the gradient of C_s. The gradient of the log-odds has the same
    direction but does not vanish where p is near 0 or 1. Starts and steps are clipped to the z_theta square.
    The model perceives each scene once; starts do not affect each other. Curves, given by their points, take steps in
    the offsets of `planning.bumps`, with free ends or not; nothing clips them.
    """
    with torch.no_grad():
        percept = model.eval().see(images)
    given = torch.from_numpy(np.array(starts, dtype=np.float32, order="C"))
    if given.ndim == 4:
        curves, b = resample(given, POINTS), torch.from_numpy(basis(free_ends)).float()
        z, least, most = given.new_zeros(*given.shape[:2], b.shape[1], 2), -np.inf, np.inf

        def logit(z: Tensor) -> Tensor:
            return model.logit(percept, curves + b @ z)

    else:
        z, least, most = given.clamp(Z_LOW, Z_HIGH), Z_LOW, Z_HIGH

        def logit(z: Tensor) -> Tensor:
            return model.logit(percept, z)

    mean, squares = torch.zeros_like(z), torch.zeros_like(z)
    path, log_odds = [z], []
    for step in range(ascent.steps):
        value, delta = _log_odds_and_delta(logit, z)
        if ascent.optimiser == "adam":
            mean = DECAY * mean + (1 - DECAY) * delta
            squares = SQUARES_DECAY * squares + (1 - SQUARES_DECAY) * delta.square()
            spread = square_root(squares / (1 - SQUARES_DECAY ** (step + 1)))
            delta = mean / (1 - DECAY ** (step + 1)) / (spread + EPSILON)
        z = (z + ascent.rate * (1 - step / ascent.steps) * delta).clamp(least, most)
        path.append(z)
        log_odds.append(value)
    with torch.no_grad():
        log_odds.append(logit(z))
    return Repairs(torch.stack(path, dim=2).numpy(), torch.sigmoid(torch.stack(log_odds, dim=2)).numpy())


def _log_odds_and_delta(logit: Callable[[Tensor], Tensor], z: Tensor) -> tuple[Tensor, Tensor]:
    """Return each path's log-odds and their gradient with respect to `z`; weights receive no gradient."""
    z = z.detach().requires_grad_()
    with torch.enable_grad():
        log_odds = logit(z)
        if not log_odds.requires_grad:  # the model ignores the path
            return log_odds, torch.zeros_like(z)
        (delta,) = torch.autograd.grad(log_odds.sum(), z)
    return log_odds.detach(), delta
