"""The IRL baseline (paper, Section "Evaluation"): a reward map r_s(p, I), and a path's advantage under it.

The paper's policy is optimal with respect to sum_i r_s(p_i, I). Here a path's return is the *mean* of r_s over SAMPLES
points, evenly spaced in the curve parameter. All paths have the same number of points, so the optimum is the same.
"""

from functools import lru_cache

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from pipeline.models.base import LogOdds, Paths, Pixels, ValidityModel, initialise, to_tensor
from pipeline.models.curves import resample
from pipeline.perception.background import subtract_background
from pipeline.perception.objects import to_bytes
from pipeline.runtime.roots import square_root
from pipeline.world.bezier import P_F, P_INIT, basis, lattice
from pipeline.world.layout import SIDE

SAMPLES = 48  # points along a path: 2.5 cm apart if it is straight; cells of the map are 4 cm wide
Contrasts, Reward = Float[Tensor, "scene 4 100 100"], Float[Tensor, "scene side side"]
SYMMETRIES = 8  # rotations by 90 degrees, each with and without reflection


class RewardMap(ValidityModel):
    """A convolutional network from image to reward map; a path is accepted if its advantage is above a threshold.

    The logit is `scale * advantage + offset`. Both are buffers, fitted to the labels after training; P > .5 accepts
    paths above `-offset / scale`. The map is averaged over the image's 8 symmetries.
    """

    scale: Tensor
    offset: Tensor
    paths: Tensor

    def __init__(self, channels: int, dilated: int, gain: float, dropout: float, lattice_side: int) -> None:
        """Build 25 x 25 layers of `channels` channels, one plain, `dilated` dilated ones; `gain` multiplies the map."""
        super().__init__()
        self.gain = gain
        layers = [nn.Conv2d(4, channels // 2, 3, stride=2, padding=1), nn.ReLU()]  # (scene, channels / 2, 50, 50)
        layers += [nn.Conv2d(channels // 2, channels, 3, stride=2, padding=1), nn.ReLU()]  # (scene, channels, 25, 25)
        for _ in range(dilated):
            layers += [nn.Conv2d(channels, channels, 3, padding=2, dilation=2), nn.ReLU()]
        layers.insert(-2, nn.Dropout2d(dropout))
        self.layers = nn.Sequential(*layers, nn.Conv2d(channels, 4, 1), nn.PixelShuffle(2))  # (scene, 1, 50, 50)
        initialise(self, no_rectifier_after=[self.layers[-2]])
        self.side = SIDE // 2
        weights = path_weights(torch.from_numpy(lattice(lattice_side)).float(), self.side)
        self.register_buffer("paths", weights, persistent=False)  # (z_theta of the lattice, side * side)
        self.register_buffer("scale", torch.tensor(1.0))
        self.register_buffer("offset", torch.tensor(0.0))

    def reward(self, contrasts: Contrasts) -> Reward:
        """Return r_s at each cell of the map, row 0 at the far edge, from the images' contrast with the table."""
        return self.gain * -F.softplus(self.layers(contrasts).squeeze(1))  # at most 0

    def perceive(self, images: Pixels) -> Float[Tensor, "scene cell"]:
        """Return the cells of the reward map and, last, the soft optimum of each scene; zeros if `scale` is 0."""
        if not self.scale:
            return images.new_zeros(len(images), self.side**2 + 1)
        return self.perceive_turned(_turned_contrasts(tuple(to_bytes(images))))

    def perceive_turned(self, contrasts: list[Contrasts]) -> Float[Tensor, "scene cell"]:
        """Return the same as `perceive`, from the images' contrast with the table under each symmetry (`turned`)."""
        reward = torch.stack([untransform(self.reward(x), g) for g, x in enumerate(contrasts)]).mean(0)
        return torch.cat([reward.flatten(1), self.soft_optimum(reward)[:, None]], dim=-1)

    def soft_optimum(self, reward: Reward) -> Float[Tensor, " scene"]:
        """Return log(mean exp(return)) over the lattice of z_theta: the log partition function up to a constant."""
        return (reward.flatten(1) @ self.paths.T).logsumexp(-1) - float(np.log(len(self.paths)))

    def advantage(self, reward: Reward, z_theta: Paths) -> LogOdds:
        """Return each path's return less the soft optimum: the log of its density relative to a uniform choice."""
        return path_return(reward, z_theta) - self.soft_optimum(reward)[:, None]

    def logit(self, percept: Tensor, z_theta: Paths) -> LogOdds:
        """Return the log-odds of validity of each path; differentiable in `z_theta` [m]."""
        reward = percept[:, :-1].unflatten(1, (self.side, self.side))
        return self.scale * (path_return(reward, z_theta) - percept[:, -1:]) + self.offset


@lru_cache(maxsize=2048)  # all models use the same images
def _contrast(image: bytes) -> Float[Tensor, "1 4 100 100"]:
    """Return the `contrast` of one 8-bit image."""
    pixels = np.frombuffer(image, np.uint8).reshape(1, SIDE, SIDE, 3)
    return contrast(*subtract_background(to_tensor(pixels.copy())))


@lru_cache(maxsize=4)  # batches; a sixth of the time
def _turned_contrasts(images: tuple[bytes, ...]) -> list[Contrasts]:
    """Return the contrasts of 8-bit images under each symmetry."""
    return turned(torch.cat([_contrast(image) for image in images]))


def turned(contrasts: Contrasts) -> list[Contrasts]:
    """Return the contrasts under each symmetry, channels last: a third faster here."""
    return [transform(contrasts, g).contiguous(memory_format=torch.channels_last) for g in range(SYMMETRIES)]


def contrast(plain: Pixels, whitening: Float[Tensor, "scene 3 3"]) -> Contrasts:
    """Return the network's input: size and local mean of the smoothed difference from the table, whitened and plain.

    Whitening scales each colour direction by the table's own variation there. A glass then stands out from wood, whose
    grain varies along another colour direction. No channel contains the hue, which does not identify a symbol.
    """
    taps = torch.tensor([1.0, 4.0, 6.0, 4.0, 1.0]).to(plain) / 16
    kernel = (taps[:, None] * taps).expand(3, 1, 5, 5).contiguous()
    smooth = F.conv2d(plain, kernel, padding=2, groups=3)
    whitened = (whitening @ smooth.flatten(2)).unflatten(-1, plain.shape[-2:])
    size, whitened_size = (square_root(x.square().sum(1)) for x in (smooth, whitened))  # `norm` takes 10 times as long
    parts = (whitened_size.asinh(), whitened.mean(1).asinh(), 8 * size, 8 * smooth.mean(1))
    return torch.stack(parts, dim=1)


def path_points(z_theta: Float[Tensor, "*path 2"]) -> Float[Tensor, "*path samples 2"]:
    """Return SAMPLES points [m] of each of the paper's paths, including both ends."""
    b = basis(np.linspace(0.0, 1.0, SAMPLES))
    ends = torch.from_numpy(b[:, :1] * P_INIT + b[:, 2:] * P_F).to(z_theta)  # (samples, 2)
    return ends + torch.from_numpy(b[:, 1:2]).to(z_theta) * z_theta[..., None, :]


def path_return(reward: Reward, z_theta: Paths) -> LogOdds:
    """Return the mean reward along each path [m], from bilinear samples of the map (edge values extended outwards)."""
    points = resample(z_theta, SAMPLES) if z_theta.ndim == 4 else path_points(z_theta)
    grid = (2 * points - 1) * torch.tensor([1.0, -1.0]).to(z_theta)  # row 0 is the far edge
    sampled = F.grid_sample(reward[:, None], grid, padding_mode="border", align_corners=False)
    return sampled.squeeze(1).mean(-1)


def path_weights(z_theta: Float[Tensor, "path 2"], side: int) -> Float[Tensor, "path cell"]:
    """Return each cell's weight in each path's return: `path_return` as a matrix."""
    points = path_points(z_theta)
    row, column = (1 - points[..., 1]) * side - 0.5, points[..., 0] * side - 0.5  # (path, samples)
    row, column = row.clamp(0, side - 1), column.clamp(0, side - 1)
    top, left = row.floor().clamp(max=side - 2), column.floor().clamp(max=side - 2)
    down, right = row - top, column - left
    weights = torch.zeros(len(z_theta), side * side).to(z_theta)
    for i, by_row in ((0, 1 - down), (1, down)):
        for j, by_column in ((0, 1 - right), (1, right)):
            cell = ((top + i) * side + left + j).long()
            weights.scatter_add_(1, cell, by_row * by_column / SAMPLES)
    return weights


def transform(images: Float[Tensor, "*batch row column"], symmetry: int) -> Float[Tensor, "*batch row column"]:
    """Apply symmetry 0..7 of the square: bits 2 and 4 reflect rows and columns, then bit 1 transposes."""
    axes = [axis for axis, bit in ((-2, 2), (-1, 4)) if symmetry & bit]
    images = images.flip(axes) if axes else images  # copies, and keeps the memory order
    return images.mT if symmetry & 1 else images


def untransform(images: Float[Tensor, "*batch row column"], symmetry: int) -> Float[Tensor, "*batch row column"]:
    """Apply the inverse of `transform`."""
    return transform(images.mT if symmetry & 1 else images, symmetry & 6)
