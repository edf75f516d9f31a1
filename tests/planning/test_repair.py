"""Gradient repair climbs specifications whose shape is known."""

import numpy as np
import torch
from torch import Tensor

from pipeline.models.base import ValidityModel
from pipeline.world.bezier import random_z_theta

IMAGES = np.zeros((3, 100, 100, 3), dtype=np.uint8)
STARTS = random_z_theta(np.random.default_rng(0), 3, 20)
RATES = {"gradient": 0.02, "normalised": 0.05, "adam": 0.05}


class Hill(ValidityModel):
    """Concave log-odds: 4 at a peak, falling with the squared distance."""

    def __init__(self, peak: tuple[float, float] = (0.3, 0.8)):
        super().__init__()
        self.peak = torch.tensor(peak)

    def perceive(self, images: Tensor) -> Tensor:
        return torch.zeros(len(images), 1)

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return 4 - 16 * ((z_theta - self.peak) ** 2).sum(-1)


class Plain(Hill):
    """Flat log-odds: the gradient is zero everywhere, though the path is looked at."""

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return -1 + 0 * z_theta.sum(-1)


class Blind(Hill):
    """Log-odds that do not depend on the path at all."""

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return torch.full(z_theta.shape[:-1], -1.0)


class Wall(Hill):
    """A peak out of reach: the log-odds grow with x for ever."""

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return z_theta[..., 0] * 10
