"""Models whose log-odds have a known shape."""

import torch
from torch import Tensor

from pipeline.models.base import ValidityModel


class Hill(ValidityModel):
    """Concave log-odds: 4 at a peak, falling with the squared distance."""

    def __init__(self, peak: tuple[float, float] = (0.3, 0.8)):
        super().__init__()
        self.peak = torch.tensor(peak)

    def perceive(self, images: Tensor) -> Tensor:
        return torch.zeros(len(images), 1)

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return 4 - 16 * ((z_theta - self.peak) ** 2).sum(-1)
