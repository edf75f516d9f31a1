"""Where paths become valid, guessed from what a model said of a few of them and from its slopes there.

A Gaussian process over z_theta that is told values and their gradients (Rasmussen and Williams, 2006, Section 9.4).
What it is told is `depth`, in which a path model's answers grow about linearly with a path's clearance, so that few
of them say much about the paths around.
"""

import torch
from jaxtyping import Float
from torch import Tensor

LENGTH = 0.2  # metres of z_theta over which depths are alike
SLOPE = 5 / (3 * LENGTH**2)  # variance of a slope [1/m^2] where that of the values is 1
SCALE = 5.0  # standard deviation of a depth nothing is known about; its mean is 0, the boundary
NOISE = 1e-3  # share of the variance of values and slopes that is believed of none: depths bend more than the kernel
DEEPEST, HIGHEST = -20.0, 2.0  # depths beyond are taken for these, without a slope
OPTIMISM = 1.0  # standard deviations by which an upper confidence bound exceeds the mean


def depth(logit: Tensor) -> Tensor:
    """Student's t's quantile, 2 degrees of freedom, over the root of 2, at this log-odds; above 0 a path is valid."""
    return torch.sinh(logit / 2).clamp(DEEPEST, HIGHEST)


class Surrogate:
    """A Gaussian process for every start, each told as many points as the others."""

    def __init__(self) -> None:
        self.z, self.told = torch.empty(0), torch.empty(0)  # (*start, seen, 2) [m]; (*start, seen, depth and slopes)

    def learn(
        self,
        z: Float[Tensor, "*start seen 2"],
        logit: Float[Tensor, "*start seen"],
        slope: Float[Tensor, "*start seen 2"],
    ) -> None:
        """Log-odds of paths [m], and their gradient [1/m]."""
        value = depth(logit)
        inside = (value > DEEPEST) & (value < HIGHEST)
        steepness = torch.where(inside, torch.cosh(logit / 2) / 2, 0.0)[..., None] * slope
        told = torch.cat([value[..., None], steepness], -1) / SCALE
        self.z = torch.cat([self.z, z], -2) if len(self.z) else z
        self.told = torch.cat([self.told, told], -2) if len(self.told) else told

    def bound(self, z: Float[Tensor, "*start path 2"]) -> Float[Tensor, "*start path"]:
        """Upper confidence bounds of the log-odds of paths [m]."""
        variance = torch.tensor([1.0, SLOPE, SLOPE]).repeat_interleave(self.z.shape[-2])
        own = torch.cat([_of_values(self.z, self.z), *_of_slopes(self.z, self.z)], -2)
        precision = torch.cholesky_inverse(torch.linalg.cholesky(own + torch.diag(NOISE * variance)))
        told = self.told.mT.flatten(-2)[..., None]  # values, then slopes along x, then along y
        across = _of_values(z, self.z)
        weight = across @ precision
        mean, spread = (weight @ told)[..., 0], (1 - (weight * across).sum(-1)).clamp(min=0).sqrt()
        return 2 * torch.asinh((SCALE * (mean + OPTIMISM * spread)).clamp(max=HIGHEST))


def _of_values(a: Float[Tensor, "*start left 2"], b: Float[Tensor, "*start right 2"]) -> Float[Tensor, "*start left _"]:
    """Covariances of values at `a` with values at `b`, slopes along x, and along y: Matern's kernel of order 5/2."""
    x, y, r = _apart(a, b)
    slope = SLOPE * (1 + r) * torch.exp(-r)
    return torch.cat([(1 + r + r * r / 3) * torch.exp(-r), slope * x, slope * y], -1)


def _of_slopes(a: Float[Tensor, "*start left 2"], b: Float[Tensor, "*start right 2"]) -> tuple[Tensor, Tensor]:
    """The same of slopes at `a`, along x and along y: the kernel's derivatives."""
    x, y, r = _apart(a, b)
    slope = SLOPE * (1 + r) * torch.exp(-r)
    bend = 5 / LENGTH**2 * SLOPE * torch.exp(-r)
    along_x = torch.cat([-slope * x, slope - bend * x * x, -bend * x * y], -1)
    return along_x, torch.cat([-slope * y, -bend * x * y, slope - bend * y * y], -1)


def _apart(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """From each right point to each left one along x and y [m], and how far that is in the kernel's unit."""
    x, y = (a[..., :, None, i] - b[..., None, :, i] for i in (0, 1))
    return x, y, 5**0.5 / LENGTH * (x * x + y * y).sqrt()
