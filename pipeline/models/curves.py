"""Curves of any kind as polylines with points evenly along them."""

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from pipeline.runtime.roots import square_root

Points = Float[Tensor, "scene path point 2"]  # [m]
Coordinate = Float[Tensor, "scene path count"]  # [m]


def resample(points: Points, count: int) -> Float[Tensor, "scene path count 2"]:
    """Return `count` points [m] at even distances along each polyline, with both ends; differentiable in `points`."""
    return torch.stack(coordinates(points, count), -1)


def coordinates(points: Points, count: int) -> tuple[Coordinate, Coordinate]:
    """Return x and y of `resample`: torch is faster with one coordinate at a time."""
    x, y = (c.contiguous() for c in points.flatten(0, 1).unbind(-1))
    with torch.no_grad():
        steps = square_root((x[:, 1:] - x[:, :-1]).square() + (y[:, 1:] - y[:, :-1]).square())
        passed = F.pad(steps.cumsum(1), (1, 0))
        aim = passed[:, -1:] * torch.linspace(0, 1, count, dtype=x.dtype)
        # As the aims lie evenly, counting the polyline's points before each of them is twice as fast as searchsorted.
        beyond = (passed * ((count - 1) / aim[:, -1:].clamp(min=1e-12)) + 0.5).long().clamp_(0, count - 1)
        beyond += aim.gather(1, beyond) <= passed  # the first aim beyond each point; `count` if there is none
        beyond += torch.arange(0, len(x) * (count + 1), count + 1)[:, None]
        counts = torch.bincount(beyond.flatten(), minlength=len(x) * (count + 1)).view(-1, count + 1)
        after = counts[:, :-1].cumsum(1).clamp_(1, x.shape[1] - 1)
        before = after - 1
        share = aim.sub_(passed.gather(1, before)).div_(steps.gather(1, before).clamp_(min=1e-12)).clamp_(0, 1)
    x, y = (torch.lerp(c.gather(1, before), c.gather(1, after), share) for c in (x, y))
    return x.unflatten(0, points.shape[:2]), y.unflatten(0, points.shape[:2])
