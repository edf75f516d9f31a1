"""Layers of networks that train side by side, one per SIMD lane: arrays end in an axis of LANES (simd_kernels).

A layer reads one array and writes the next. In the backward pass its output array holds the loss's gradient. The
layer adds to its weights' gradient and overwrites its input array with the input's gradient. Planes have a border of
zeros.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import nn

from pipeline.training.vae.engines import simd_kernels as lanes
from pipeline.training.vae.engines.simd_kernels import LANES


def allocate(*shape: int) -> Float[Array, "*shape lane"]:
    """Return zeros aligned to cache lines: a vector that straddles two lines takes twice as long."""
    size = math.prod(shape) * LANES
    buffer = np.zeros(size + 16, np.float32)
    start = -buffer.ctypes.data // 4 % 16
    return buffer[start : start + size].reshape(*shape, LANES)


NO_BIAS = allocate(1)  # zeros


class Parameter:
    """A layer's weights or biases and their gradient (..., lane); `tensor` shares the memory, for optimisers."""

    def __init__(self, *shape: int):
        self.value, self.gradient = allocate(*shape), allocate(*shape)
        self.tensor = nn.Parameter(torch.from_numpy(self.value))
        self.tensor.grad = torch.from_numpy(self.gradient)


class Layer(ABC):
    """A map from array `x` to array `y`, each of one scene."""

    x: Array
    y: Array

    @abstractmethod
    def forward(self) -> None:
        """Compute y from x."""

    @abstractmethod
    def backward(self, scene: int) -> None:
        """Overwrite x with its gradient and accumulate the weights' gradient, given the gradient of y in y."""


class Trained(Layer):
    """A layer with weights; `mode` is the operation of `product` on y, `back` the one on the gradient of x."""

    weight: Parameter
    bias: Parameter

    def finish(self) -> None:
        """Add the remaining terms to the gradient of weight and bias, after all scenes."""

    @abstractmethod
    def as_torch(self, weight: Array, bias: Array) -> tuple[Array, Array]:
        """Return views of arrays of the parameters' shape in torch's axis order, lanes last."""


class Convolution(Trained):
    """nn.Conv2d that halves the side, or nn.ConvTranspose2d that doubles it; x is rectified, or holds the images."""

    def __init__(
        self,
        module: nn.Conv2d | nn.ConvTranspose2d,
        x: Float[Array, "row column channel lane"],
        mode: int,
        back: int | None,
    ):
        self.halves = isinstance(module, nn.Conv2d)
        side = len(x) - 2
        side = (side + 1) // 2 if self.halves else 2 * side - 1 + int(module.output_padding[0])
        self.x, self.y, self.mode, self.back = x, allocate(side + 2, side + 2, module.out_channels), mode, back
        self.big, self.small = (self.x, self.y) if self.halves else (self.y, self.x)
        self.weight = Parameter(3, 3, self.big.shape[2], self.small.shape[2])
        self.bias = Parameter(module.out_channels)

    def forward(self):
        self._convolve(self.halves, self.bias.value, self.mode)

    def backward(self, scene):
        lanes.correlate(self.big, self.small, self.weight.gradient)
        lanes.total(self.y, self.bias.gradient)
        if self.back is not None:
            self._convolve(not self.halves, NO_BIAS, self.back)

    def _convolve(self, halves: bool, bias: Array, mode: int) -> None:
        if halves:
            lanes.gather(self.big, self.weight.value, bias, self.small, mode)
        else:
            lanes.scatter(self.small, self.weight.value, bias, self.big, mode)

    def as_torch(self, weight, bias):
        return weight.transpose(3, 2, 0, 1, 4), bias


class Flatten(Layer):
    """nn.Flatten from planes, without their border, to a row, or nn.Unflatten from a row to planes."""

    def __init__(self, x: Array, y: Array):
        self.x, self.y = x, y
        planes, row = (x, y) if x.ndim > y.ndim else (y, x)
        inside = planes[1:-1, 1:-1].transpose(2, 0, 1, 3)  # (channel, row, column, lane), torch's order
        views = (inside, row.reshape(inside.shape))
        self.source, self.target = views if planes is x else views[::-1]

    def forward(self):
        self.target[:] = self.source

    def backward(self, scene):
        self.source[:] = self.target


class Dense(Trained):
    """nn.Linear from rows of features to rows of features.

    Its weights exceed the cache, so their gradient is computed once, from values that each scene has stored.
    """

    def __init__(
        self, x: Float[Array, "row input lane"], y: Float[Array, "row output lane"], mode: int, back: int, scenes: int
    ):
        self.x, self.y, self.mode, self.back = x, y, mode, back
        self.read, self.slope = (allocate(scenes, *array.shape[:2]) for array in (x, y))
        self.weight, self.bias = Parameter(x.shape[1], y.shape[1]), Parameter(y.shape[1])

    def forward(self):
        lanes.dense(self.x, self.weight.value, self.bias.value, self.y, self.mode)

    def backward(self, scene):
        self.read[scene], self.slope[scene] = self.x, self.y
        lanes.dense_backward(self.y, self.weight.value, self.x, self.back)

    def finish(self):
        read, slope = (array.reshape(-1, *array.shape[2:]) for array in (self.read, self.slope))
        lanes.dense_weights(read, slope, self.weight.gradient)
        lanes.total(slope[None], self.bias.gradient)

    def as_torch(self, weight, bias):
        return weight.transpose(1, 0, 2), bias


def forward(layers: Sequence[Layer]) -> None:
    """Pass one scene from the first layer to the last."""
    for layer in layers:
        layer.forward()


def backward(layers: Sequence[Layer], scene: int) -> None:
    """Pass the gradient from the last layer to the first."""
    for layer in reversed(layers):
        layer.backward(scene)
