"""The interface every specification model answers to: P(valid | image, path) for one user."""

import math
from abc import ABC, abstractmethod
from collections.abc import Container, Mapping
from inspect import signature
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from pipeline.runtime.errors import InputError
from pipeline.world.layout import SIDE

Array = np.ndarray
SCENES_PER_BATCH = 32  # activations stay in the cache; results depend on it in the last bit at most


def check_images(images: Any) -> None:
    """Raise InputError unless images are uint8 (scene, 100, 100, 3)."""
    shape, dtype = getattr(images, "shape", None), getattr(images, "dtype", type(images).__name__)
    if shape is None or len(shape) != 4 or shape[1:] != (SIDE, SIDE, 3) or dtype != np.uint8:
        raise InputError(
            f"images are {dtype} of shape {shape}: expected uint8 of shape (scene, {SIDE}, {SIDE}, 3); "
            "scale intensities in [0, 1] by 255 and convert them"
        )


def check_paths(z_theta: Any, scenes: int, name: str = "z_theta") -> None:
    """Raise InputError unless z_theta, called `name`, is finite and of shape (scenes, path, 2)."""
    shape = np.shape(z_theta)
    if len(shape) != 3 or shape[0] != scenes or shape[2] != 2:
        raise InputError(
            f"{name} has shape {shape}: expected ({scenes}, path, 2), the paths of each of {scenes} scenes"
        )
    if not np.isfinite(z_theta).all():
        raise InputError(f"{name} has NaN or infinite values: drop those paths")


def to_tensor(images: UInt8[Array, "scene 100 100 3"]) -> Float[Tensor, "scene 3 100 100"]:
    """Return images as the networks take them: [0, 1], channels first, stored channels last."""
    return torch.from_numpy(images).permute(0, 3, 1, 2).float().div(255).contiguous(memory_format=torch.channels_last)


def to_bytes(images: Float[Tensor, "scene 3 100 100"]) -> list[bytes]:
    """Return each image's 8-bit pixels by row and column: the inverse of `to_tensor`."""
    pixels = images.detach().permute(0, 2, 3, 1).mul(255).round().to(torch.uint8).contiguous().numpy()
    return [image.tobytes() for image in pixels]


class ValidityModel(nn.Module, ABC):
    """One user's specification C_s in two steps: a scene to a percept, a percept and a path to the odds of validity."""

    settings: Mapping[str, Any] = {}  # what `pipeline.fit` built the model of, for `pipeline.save`

    @abstractmethod
    def perceive(self, images: Float[Tensor, "scene 3 100 100"]) -> Tensor:
        """Return the percept of each scene (first axis: scene); no path enters."""

    @abstractmethod
    def logit(self, percept: Tensor, z_theta: Float[Tensor, "scene path 2"]) -> Float[Tensor, "scene path"]:
        """Return the log-odds that each path [m] is valid; differentiable in `z_theta`."""

    def forward(
        self, images: Float[Tensor, "scene 3 100 100"], z_theta: Float[Tensor, "scene path 2"]
    ) -> Float[Tensor, "scene path"]:
        """Return the log-odds of validity from the images themselves."""
        return self.logit(self.perceive(images), z_theta)

    @torch.no_grad()
    def probability(
        self, images: UInt8[Array, "scene 100 100 3"], z_theta: Float[Array, "scene path 2"]
    ) -> Float[Array, "scene path"]:
        """Return P(valid) of each path [m] as float32; sets `eval()` mode, keeps no gradient.

        Raises InputError for images that are not uint8 (scene, 100, 100, 3), and for paths that do not fit them or are
        not finite.
        """
        check_images(images)
        check_paths(z_theta, len(images))
        self.eval()
        z = torch.as_tensor(np.asarray(z_theta, dtype=np.float32))
        parts = [
            torch.sigmoid(self(to_tensor(images[i : i + SCENES_PER_BATCH]), z[i : i + SCENES_PER_BATCH]))
            for i in range(0, len(images), SCENES_PER_BATCH)
        ]
        return torch.cat(parts).numpy()


@torch.no_grad()
def initialise(network: nn.Module, no_rectifier_after: Container[nn.Module]) -> None:
    """Draw weights from torch's global generator so that each layer hands on the mean square it is given; biases are 0.

    He et al. (2015), "Delving deep into rectifiers". A rectifier loses half of the mean square, which weights twice as
    large in the square make up for; the layers in `no_rectifier_after` have none behind them. Of torch's own weights
    each layer passes on a part alone, and it takes twice the steps until the loss sees the picture
    (docs/decisions/003-training-budget.md).
    """
    for layer in network.modules():
        if isinstance(layer, nn.Linear | nn.Conv2d | nn.ConvTranspose2d):
            fan_in = layer.weight[0].numel()
            if isinstance(layer, nn.ConvTranspose2d):  # an output meets the kernel at every stride-th of its taps
                fan_in = layer.in_channels * math.prod(layer.kernel_size) / math.prod(layer.stride)
            layer.weight.normal_(std=math.sqrt((1 if layer in no_rectifier_after else 2) / fan_in))
            if layer.bias is not None:
                layer.bias.zero_()


def untrained(kind: type[ValidityModel], shape: Mapping[str, Any], seed: int) -> ValidityModel:
    """Return a `kind` of that `shape` (its keyword arguments) in eval mode, its weights drawn from `seed` alone.

    Torch's global generator is left as it was. Raises InputError for a keyword too many or missing.
    """
    parameters = signature(kind).parameters.values()
    required = {p.name for p in parameters if p.default is p.empty}
    if wrong := sorted({*shape} - {p.name for p in parameters} | required - {*shape}):
        raise InputError(
            f"{kind.__name__} got {', '.join(shape) or 'nothing'} (`model:` in conf/variants), wrong or missing: "
            f"{', '.join(wrong)}; it takes {', '.join(map(str, parameters))}"
        )
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return kind(**shape).eval()
