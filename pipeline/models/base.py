"""The common interface of all specification models: P(valid | image, path) for one user."""

import math
from abc import ABC, abstractmethod
from collections.abc import Container, Mapping
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from pipeline.runtime.errors import InputError
from pipeline.world.bezier import Z_HIGH, Z_LOW
from pipeline.world.layout import SIDE
from pipeline.world.told import Told

Array = np.ndarray
Images = UInt8[Array, "scene 100 100 3"]  # [0, 255]
Pixels = Float[Tensor, "scene 3 100 100"]  # [0, 1]
Paths = Float[Tensor, "scene path 2"] | Float[Tensor, "scene path point 2"]  # z_theta, or points of any curve [m]
LogOdds = Float[Tensor, "scene path"]
Z_RANGE_M = -1.5, 2.5  # of a control point [m]: it bends a path up to half a metre beyond the table, as hands may go
SCENES_PER_BATCH = 32  # keeps activations in the cache; changes results at most in the last bit


def is_array(values: Any) -> bool:
    """Return whether the values are a NumPy array without a mask, which no model would heed."""
    return isinstance(values, np.ndarray) and not np.ma.isMaskedArray(values)


def check_images(images: Any, name: str = "images") -> None:
    """Raise InputError, which calls the argument `name`, unless it is uint8 (scene, 100, 100, 3), or `Told`."""
    if isinstance(images, Told):
        return
    expected = f"uint8 of shape (scene, {SIDE}, {SIDE}, 3)"
    if not is_array(images):
        raise InputError(f"{name} is {type(images).__name__}: expected a NumPy array, {expected}")
    if images.ndim != 4 or not len(images) or images.shape[1:] != (SIDE, SIDE, 3) or images.dtype != np.uint8:
        hint = "" if images.dtype == np.uint8 else "; scale intensities in [0, 1] by 255 and convert them"
        raise InputError(f"{name} are {images.dtype} of shape {images.shape}: expected {expected}{hint}")


def check_paths(z_theta: Any, scenes: int, name: str = "z_theta") -> None:
    """Raise InputError, which calls the argument `name`, unless it holds metres of shape (scenes, path, 2).

    Points of curves, of shape (scenes, path, point, 2) with two points at least, are right, too.
    """
    expected = f"({scenes}, path, 2), or ({scenes}, path, point, 2): the paths of each of {scenes} scenes"
    if not is_array(z_theta) or z_theta.dtype.kind not in "fiu":
        given = z_theta.dtype if is_array(z_theta) else type(z_theta).__name__
        raise InputError(f"{name} is {given}: expected a NumPy array of numbers [m] of shape {expected}")
    curves = z_theta.ndim == 4 and z_theta.shape[2] > 1
    if not (curves or z_theta.ndim == 3) or len(z_theta) != scenes or z_theta.shape[-1] != 2:
        raise InputError(f"{name} has shape {z_theta.shape}: expected {expected}")
    if not np.isfinite(z_theta).all():
        raise InputError(f"{name} has NaN or infinite values: drop those paths")
    furthest = float(z_theta.flat[np.abs(z_theta - 0.5).argmax()]) if z_theta.size else 0.0
    if not Z_RANGE_M[0] <= furthest <= Z_RANGE_M[1]:
        most = f"at most {Z_RANGE_M[0]} to {Z_RANGE_M[1]}; 100 pixels are one metre"
        raise InputError(f"{name} reaches {furthest:.3g}: expected metres as a rule within [{Z_LOW}, {Z_HIGH}], {most}")


def to_tensor(images: Images) -> Pixels:
    """Return images as network input: float in [0, 1], channels first, in channels-last memory format."""
    pixels = torch.from_numpy(np.array(images, order="C")).permute(0, 3, 1, 2)
    return pixels.float().div(255).contiguous(memory_format=torch.channels_last)


class ValidityModel(nn.Module, ABC):
    """One user's specification C_s in two steps: image to percept, then percept and path to log-odds of validity."""

    settings: Mapping[str, Any] = {}  # settings that `pipeline.fit` built the model from, for `pipeline.save`

    @abstractmethod
    def perceive(self, images: Pixels) -> Tensor:
        """Return the percept of each scene (first axis: scene); it does not depend on the path."""

    @abstractmethod
    def logit(self, percept: Tensor, z_theta: Paths) -> LogOdds:
        """Return the log-odds that each path [m] is valid; differentiable in `z_theta`.

        Points of curves may lie at any distances along them: models resample them evenly (`curves.resample`).
        """

    def see(self, scenes: Any) -> Tensor:
        """Return the percept of pictures or, if the model takes them, of objects that somebody told."""
        if isinstance(scenes, Told):
            raise InputError(f"{type(self).__name__} sees pictures alone: expected uint8 (scene, {SIDE}, {SIDE}, 3)")
        return self.perceive(to_tensor(scenes))

    def probability(
        self, images: Any, z_theta: Float[Array, "scene path 2"] | Float[Array, "scene path point 2"]
    ) -> Float[Array, "scene path"]:
        """Return P(valid) of each path [m] as float32; switches to `eval()` mode and keeps no gradient.

        The caller's autocast and default device do not matter. Raises InputError unless images are uint8
        (scene, 100, 100, 3) and paths are finite metres (scene, path, 2) or (scene, path, point, 2).
        """
        check_images(images)
        check_paths(z_theta, len(images))
        self.eval()
        some = [slice(i, i + SCENES_PER_BATCH) for i in range(0, len(images), SCENES_PER_BATCH)]
        with torch.no_grad(), torch.device("cpu"), torch.autocast("cpu", enabled=False):
            z = torch.from_numpy(np.array(z_theta, dtype=np.float32, order="C"))
            return torch.cat([self.logit(self.see(images[s]), z[s]).sigmoid() for s in some]).numpy()

    def reconstruction_over_flat(self, images: Images) -> float:
        """Return the root mean square error of decoded images over that of flat ones; NaN where there is no decoder."""
        return math.nan


@torch.no_grad()
def initialise(network: nn.Module, no_rectifier_after: Container[nn.Module]) -> None:
    """Draw weights from torch's global generator so that every layer preserves the mean square; set biases to 0.

    Source: He et al. (2015), "Delving deep into rectifiers". A rectifier halves the mean square, so the weights'
    variance is doubled, except in the layers of `no_rectifier_after`. With torch's default weights training takes twice
    as many steps before the loss depends on the image (docs/decisions/003-training-budget.md).
    """
    for layer in network.modules():
        if isinstance(layer, nn.Linear | nn.Conv2d | nn.ConvTranspose2d):
            fan_in = layer.weight[0].numel()
            if isinstance(layer, nn.ConvTranspose2d):  # each output meets only every stride-th kernel tap
                fan_in = layer.in_channels * math.prod(layer.kernel_size) / math.prod(layer.stride)
            layer.weight.normal_(std=math.sqrt((1 if layer in no_rectifier_after else 2) / fan_in))
            if layer.bias is not None:
                layer.bias.zero_()


def untrained(kind: type[ValidityModel], shape: Mapping[str, Any], seed: int) -> ValidityModel:
    """Return a model of class `kind` with keyword arguments `shape`, in eval mode; `seed` alone decides its weights.

    Leaves torch's global generator unchanged.
    """
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(seed)
        return kind(**shape).eval()
