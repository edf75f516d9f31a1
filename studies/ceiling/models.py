"""The paper's classifier with another input: pixel coordinates, the drawn path, or the truth."""

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor, nn

from pipeline.models.base import initialise
from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE, BetaVae
from pipeline.world.bezier import curve
from pipeline.world.layout import SIDE, SYMBOLS, Layouts

POINTS = 64  # corners of a drawn path
WIDTH_PX = 3  # of a drawn path
SUBPIXEL_BITS = 4  # of its corners' coordinates
LENGTH_UNIT_M = 0.1  # unit of an item's size in its code [m]


class Coordinates(BetaVae):
    """A model whose encoder also reads x and y of each pixel, from -1 to 1.

    Source: Liu et al. (2018), "An intriguing failing of convolutional neural networks and the CoordConv solution".
    """

    places: Tensor

    def __init__(self, latent: int, channels: Sequence[int], hidden: int):
        super().__init__(latent, channels, hidden)
        self.features[0] = nn.Conv2d(5, channels[0], 3, stride=2, padding=1)
        initialise(self.features[0], no_rectifier_after=())
        axis = torch.linspace(-1, 1, SIDE)
        self.register_buffer("places", torch.stack(torch.meshgrid(axis, -axis, indexing="xy")))

    def encode(self, images: Float[Tensor, "scene 3 100 100"]) -> Float[Tensor, "scene feature"]:
        """Return the features of images with coordinates."""
        places = self.places.expand(len(images), -1, -1, -1)
        return self.features(torch.cat([(images - self.centre) / self.spread, places], 1))


class PathDrawn(BetaVae):
    """A model that encodes image and path together: the path is a fourth channel of the image.

    A percept is the first layer's response to the image. The layer is linear, so the path's response is added to it.
    """

    def __init__(self, latent: int, channels: Sequence[int], hidden: int):
        super().__init__(latent, channels, hidden)
        self.path = nn.Conv2d(1, channels[0], 3, stride=2, padding=1, bias=False)
        initialise(self.path, no_rectifier_after=())
        self.code, self.mean = self.mean, nn.Identity()
        self.to(memory_format=torch.channels_last)  # pyright: ignore[reportCallIssue]

    def perceive(self, images: Float[Tensor, "scene 3 100 100"]) -> Float[Tensor, "scene channel 50 50"]:
        """Return the first layer's response to the images."""
        return self.encode(images)

    def encode(self, images: Float[Tensor, "scene 3 100 100"]) -> Float[Tensor, "scene channel 50 50"]:
        """Return the first layer's response to the images."""
        return self.features[0]((images - self.centre) / self.spread)

    def logit(
        self, percept: Float[Tensor, "scene channel 50 50"], z_theta: Float[Tensor, "scene path 2"]
    ) -> Float[Tensor, "scene path"]:
        """Return the log-odds of validity of each path [m]; without a gradient in `z_theta` through the drawing."""
        paths = z_theta.shape[1]
        first = percept.repeat_interleave(paths, 0) + self.path(draw_paths(z_theta).flatten(0, 1)[:, None])
        code = self.code(self.features[1:](first)).unflatten(0, (-1, paths))  # (scene, path, latent)
        return self.classifier(torch.cat([code, (z_theta - Z_CENTRE) / Z_SCALE], -1)).squeeze(-1)


def draw_paths(z_theta: Float[Tensor, "scene path 2"]) -> Float[Tensor, "scene path 100 100"]:
    """Draw each path [m] three pixels wide: 1 on it, 0 elsewhere; row 0 is at the far edge, as in images."""
    x, y = np.moveaxis(SIDE * curve(z_theta.detach().numpy().reshape(-1, 2), POINTS), -1, 0)  # [pixel]
    corners = np.stack([x - 0.5, SIDE - 0.5 - y], -1)  # OpenCV counts from the first pixel's centre
    corners = np.round(corners * 2**SUBPIXEL_BITS).astype(np.int32)
    drawn = np.zeros((len(corners), SIDE, SIDE), np.float32)
    for image, path in zip(drawn, corners, strict=True):
        cv2.polylines(image, [path], isClosed=False, color=1, thickness=WIDTH_PX, shift=SUBPIXEL_BITS)
    return torch.from_numpy(drawn).unflatten(0, z_theta.shape[:2])


def true_code(layouts: Layouts, slots: int) -> Float[Array, "scene number"]:
    """Return what a perfect encoder knows of each scene: position, size, direction and symbol of each item.

    Numbers of an empty slot are 0. A direction is that of a segment without sign, so it is given by twice its angle.
    """
    x, y = np.moveaxis((layouts.centre - Z_CENTRE) / Z_SCALE, -1, 0)
    twice = layouts.half_length / LENGTH_UNIT_M * np.exp(2j * layouts.angle)
    symbol = layouts.symbol[..., None] == np.arange(len(SYMBOLS))
    numbers = [x, y, layouts.radius / LENGTH_UNIT_M, twice.real, twice.imag, *np.moveaxis(symbol, -1, 0)]
    code = np.where(layouts.present[..., None], np.stack(numbers, -1), 0.0)[:, :slots]
    return code.reshape(len(layouts), -1)
