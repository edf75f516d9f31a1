"""Curves of any kind as polylines with points evenly along them."""

import torch
from jaxtyping import Float
from torch import Tensor

from pipeline.runtime.roots import square_root

Points = Float[Tensor, "scene path point 2"]  # [m]


def resample(points: Points, count: int) -> Float[Tensor, "scene path count 2"]:
    """Return `count` points [m] at even distances along each polyline, with both ends; differentiable in `points`."""
    flat = points.flatten(0, 1)
    with torch.no_grad():
        steps = square_root((flat[:, 1:] - flat[:, :-1]).square().sum(-1))
        passed = torch.cat([steps.new_zeros(len(steps), 1), steps.cumsum(1)], 1)
        aim = passed[:, -1:] * torch.linspace(0, 1, count, dtype=flat.dtype)
        after = torch.searchsorted(passed, aim).clamp(1, flat.shape[1] - 1)
        share = (aim - passed.gather(1, after - 1)) / steps.gather(1, after - 1).clamp(min=1e-12)
        share = share.clamp(0, 1)[..., None]
    before, beyond = (flat.gather(1, index[..., None].expand(-1, -1, 2)) for index in (after - 1, after))
    return (before + share * (beyond - before)).unflatten(0, points.shape[:2])
