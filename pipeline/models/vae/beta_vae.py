"""The paper's model (Section "Specification Model"): a beta-VAE and a classifier of [z_image, z_theta]."""

import math
from collections.abc import Sequence
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from pipeline.models.base import Images, LogOdds, Paths, Pixels, ValidityModel, initialise, to_tensor
from pipeline.models.curves import resample
from pipeline.runtime.errors import InputError
from pipeline.world.layout import SIDE

Z_CENTRE, Z_SCALE = 0.5, 0.7  # maps z_theta [m], uniform on [-.2, 1.2], to [-1, 1]
MIN_SPREAD = 0.01  # of a channel that is constant in all training images [1 = white]
CELL_SHARE = 0.3  # standard deviation of a cell's own part of the initial weights, relative to the whole
LOG_VARIANCE = -4.0  # initial value of q's log-variance: nearly no noise
OUTPUT_GAIN = 0.3  # of the decoder's initial output weights: its first images are nearly the mean colour
TAPS = torch.tensor([0.5, 1.0, 0.5])  # of bilinear interpolation between pixels two apart


class BetaVae(ValidityModel):
    """The architecture of the paper's Figure "arch": encoder q_phi, mirrored decoder p_psi and classifier C_s.

    The encoder reads images minus `centre`, divided by `spread`: buffers that `standardise` sets. A path has
    `path_numbers` numbers: the paper's two of z_theta, or the coordinates of so many points evenly along any curve.
    """

    centre: Tensor
    spread: Tensor

    def __init__(self, latent: int = 15, channels: Sequence[int] = (16, 8, 4), hidden: int = 64, path_numbers: int = 2):
        super().__init__()
        self.path_numbers = path_numbers
        self.latent, widths, sides = latent, [3, *channels], [SIDE]
        encode: list[nn.Module] = []
        for before, after in pairwise(widths):
            encode += [nn.Conv2d(before, after, 3, stride=2, padding=1), nn.ReLU()]
            sides.append((sides[-1] + 1) // 2)  # image sides: 100, 50, 25, 13
        flat = widths[-1] * sides[-1] ** 2
        self.features = nn.Sequential(*encode, nn.Flatten())
        self.mean = nn.Linear(flat, latent)
        self.log_variance = nn.Linear(flat, latent)
        decode = [nn.Linear(latent, flat), nn.ReLU(), nn.Unflatten(1, (widths[-1], sides[-1], sides[-1]))]
        for (before, after), (small, big) in zip(pairwise(widths[::-1]), pairwise(sides[::-1]), strict=True):
            odd = big - (2 * small - 1)  # pixel lost by rounding up when halving: 0 or 1
            decode += [nn.ConvTranspose2d(before, after, 3, stride=2, padding=1, output_padding=odd), nn.ReLU()]
        self.decode = nn.Sequential(*decode[:-1], nn.Sigmoid())  # the output is in [0, 1]
        self.classifier = nn.Sequential(
            nn.Linear(latent + path_numbers, hidden),
            nn.ReLU(),
            nn.Linear(hidden, hidden),
            nn.ReLU(),
            nn.Linear(hidden, 1),
        )
        initialise(self, no_rectifier_after=(self.mean, self.log_variance, self.decode[-2], self.classifier[-1]))
        self._smooth_decoder()
        self.register_buffer("centre", torch.zeros(3, 1, 1))
        self.register_buffer("spread", torch.ones(3, 1, 1))
        self.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]

    def perceive(self, images: Pixels) -> Float[Tensor, "scene latent"]:
        """Return z_image of each scene: the mean of q(z_image | I), not a sample."""
        return self.mean(self.encode(images))

    def encode(self, images: Pixels) -> Float[Tensor, "scene feature"]:
        """Return the features that mean and log-variance of q(z_image | I) are linear in."""
        return self.features((images - self.centre) / self.spread)

    @torch.no_grad()
    def _smooth_decoder(self) -> None:
        """Start from smooth images and little noise: 500 steps then suffice (docs/decisions/025-convergence.md).

        The transposed convolutions interpolate bilinearly (Long et al., 2015, "Fully convolutional networks"); random
        kernels draw a checkerboard instead. The first layer's weights are nearly the same for all cells of a channel.
        """
        transposed = [layer for layer in self.decode if isinstance(layer, nn.ConvTranspose2d)]
        first = self.decode[0].get_parameter("weight")
        cells = first.unflatten(0, (transposed[0].in_channels, -1))  # (channel, cell, latent)
        cells.copy_(math.sqrt(1 - CELL_SHARE**2) * cells[:, :1] + CELL_SHARE * cells)
        for layer in transposed:
            centre = layer.weight[..., 1:2, 1:2]
            layer.weight.copy_(1.5 * centre * TAPS[:, None] * TAPS)  # 1.5: He's variance is shared by 9 / 4 taps
        transposed[-1].weight.mul_(OUTPUT_GAIN)
        self.log_variance.bias.fill_(LOG_VARIANCE)

    @torch.no_grad()
    def standardise(self, images: Images) -> None:
        """Set each channel's centre and spread to those of the training images, the output bias to the mean colour."""
        pixels = to_tensor(images).transpose(0, 1).flatten(1).double()  # (channel, pixel)
        self.centre.copy_(pixels.mean(1)[:, None, None])
        self.spread.copy_(pixels.std(1).clamp(min=MIN_SPREAD)[:, None, None])
        self.decode[-2].get_parameter("bias").copy_(self.centre.flatten().clamp(0.01, 0.99).logit())

    def logit(self, percept: Float[Tensor, "scene latent"], z_theta: Paths) -> LogOdds:
        """Return the log-odds of validity of each path [m] given z_image."""
        z_theta, z_image = self.numbers(z_theta), percept[:, None].expand(-1, z_theta.shape[1], -1)
        return self.classifier(torch.cat([z_image, (z_theta - Z_CENTRE) / Z_SCALE], dim=-1)).squeeze(-1)

    def numbers(self, paths: Paths) -> Float[Tensor, "scene path number"]:
        """Return the numbers that the classifier reads of each path; raise InputError for another kind of path."""
        points = self.path_numbers // 2
        if paths.ndim == 3 and paths.shape[-1] == self.path_numbers:
            return paths
        if paths.ndim == 3 or points == 1:
            kind = "z_theta, (scene, path, 2)" if points == 1 else "points of curves, (scene, path, point, 2)"
            raise InputError(f"paths have shape {tuple(paths.shape)}: this model was fitted to {kind}")
        return resample(paths, points).flatten(2)

    @torch.no_grad()
    def reconstruction_over_flat(self, images: Images) -> float:
        """Return the root mean square error of decoded means of z_image over that of each scene's mean colour."""
        x = to_tensor(images)
        squared_error = (self.decode(self.perceive(x)) - x).square().mean()
        return math.sqrt(squared_error / x.var((2, 3), correction=0).mean())

    @torch.no_grad()
    def set_constant_head(self, probability: float) -> None:
        """Make the classifier answer `probability` for all inputs: last layer's weight 0, bias the log-odds."""
        self.classifier[-1].get_parameter("weight").zero_()
        self.classifier[-1].get_parameter("bias").fill_(math.log(probability) - math.log1p(-probability))
