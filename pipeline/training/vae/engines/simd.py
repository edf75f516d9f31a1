"""Fit several users' models at once, one per SIMD lane of the processor (simd_kernels).

The loss is Eq. 1 (models/vae/losses.py `equation_1`); its gradient here was derived by hand, and tests hold it against
that of `equation_1` in double precision. Each model has its own images, demonstrations (any number) and seed; its
result does not depend on the other models, to the last bit. Scenes pass one at a time, so that they stay in the cache.
"""

import math
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.special import expit, log_expit
from torch import nn

from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE, BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.training.loop import Losses, minimise, pad_demonstrations, row_weights
from pipeline.training.vae.engines import fit_models
from pipeline.training.vae.engines import simd_kernels as lanes
from pipeline.training.vae.engines.simd_kernels import GATE, LANES, PUT, RELU
from pipeline.world.layout import SIDE


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


class Flatten:
    """nn.Flatten from planes, without their border of zeros, to a row, or nn.Unflatten from a row to planes.

    A layer maps x to y, each of one scene, lanes last. `backward` overwrites x with its gradient, given that of y in y.
    """

    def __init__(self, x: Array, y: Array):
        self.y = y
        planes, row = (x, y) if x.ndim > y.ndim else (y, x)
        inside = planes[1:-1, 1:-1].transpose(2, 0, 1, 3)  # (channel, row, column, lane), torch's order
        views = (inside, row.reshape(inside.shape))
        self.source, self.target = views if planes is x else views[::-1]

    def forward(self) -> None:
        self.target[:] = self.source

    def backward(self, scene: int) -> None:
        self.source[:] = self.target


class Convolution:
    """nn.Conv2d that halves the side of planes (row, column, channel, lane), or nn.ConvTranspose2d that doubles it.

    x is rectified, or holds the images. `mode` is the operation of `product` on y, `back` the one on the gradient of x
    (None: not needed).
    """

    axes = 3, 2, 0, 1, 4  # of the weights in torch's order, lanes last

    def __init__(self, module: nn.Conv2d | nn.ConvTranspose2d, x: Array, mode: int, back: int | None):
        halves, side = isinstance(module, nn.Conv2d), len(x) - 2
        side = (side + 1) // 2 if halves else 2 * side - 1 + int(module.output_padding[0])
        self.x, self.y, self.mode, self.back = x, allocate(side + 2, side + 2, module.out_channels), mode, back
        self.big, self.small = (self.x, self.y) if halves else (self.y, self.x)
        self.map, self.adjoint = (lanes.gather, lanes.scatter) if halves else (lanes.scatter, lanes.gather)
        self.weight = Parameter(3, 3, self.big.shape[2], self.small.shape[2])
        self.bias = Parameter(module.out_channels)

    def forward(self) -> None:
        self.map(self.x, self.weight.value, self.bias.value, self.y, self.mode)

    def backward(self, scene: int) -> None:
        lanes.correlate(self.big, self.small, self.weight.gradient)
        lanes.total(self.y, self.bias.gradient)
        if self.back is not None:
            self.adjoint(self.y, self.weight.value, NO_BIAS, self.x, self.back)


class Dense:
    """nn.Linear from rows of features to rows of features; `mode` and `back` as in `Convolution`.

    Its weights exceed the cache, so their gradient is computed once (`finish`), from values that each scene has stored.
    """

    axes = 1, 0, 2

    def __init__(self, x: Float[Array, "row input lane"], outputs: int, mode: int, back: int, scenes: int):
        self.x, self.y, self.mode, self.back = x, allocate(len(x), outputs), mode, back
        self.read, self.slope = (allocate(scenes, *array.shape[:2]) for array in (x, self.y))
        self.weight, self.bias = Parameter(x.shape[1], outputs), Parameter(outputs)

    def forward(self) -> None:
        lanes.dense(self.x, self.weight.value, False, self.bias.value, self.y, self.mode)

    def backward(self, scene: int) -> None:
        self.read[scene], self.slope[scene] = self.x, self.y
        lanes.dense(self.y, self.weight.value, True, NO_BIAS, self.x, self.back)

    def finish(self) -> None:
        read, slope = (array.reshape(-1, *array.shape[2:]) for array in (self.read, self.slope))
        lanes.dense_weights(read, slope, self.weight.gradient)
        lanes.total(slope[None], self.bias.gradient)


Layer = Convolution | Dense | Flatten


class Stack:
    """`LANES` models of one shape, as layers that process one scene at a time with its n paths per model.

    Models with fewer paths have padded rows with weight 0, which add zeros to every sum.
    """

    def __init__(self, models: Sequence[BetaVae], weights: Weights, n: Sequence[int], scenes: int):
        model = models[0]
        self.alpha, self.beta = weights.alpha / (scenes * SIDE * SIDE * 3), weights.beta / scenes
        self.gamma = (weights.gamma / scenes * row_weights(n)).astype(np.float32)  # (row, lane)
        names = {module: name for name, module in model.named_modules()}
        self.layers: dict[tuple[str, ...], Convolution | Dense] = {}  # by the modules that own the weights

        def add(chain: list[Layer], layer: Layer, *modules: nn.Module) -> Array:
            if not isinstance(layer, Flatten):
                self.layers[tuple(names[module] for module in modules)] = layer
            chain.append(layer)
            return layer.y

        def dense(chain: list[Layer], x: Array, mode: int, back: int, *modules: nn.Linear) -> Array:
            return add(chain, Dense(x, sum(module.out_features for module in modules), mode, back, scenes), *modules)

        self.encoder: list[Layer] = []
        statistics = np.stack([[own.centre.flatten(), 1 / own.spread.flatten()] for own in models], -1)
        self.centre, self.factor = np.tile(statistics[:, None], (1, SIDE, 1, 1))  # standardise the encoder's input
        self.intensities = allocate(SIDE + 2, SIDE + 2, 3)
        self.image = planes = allocate(SIDE + 2, SIDE + 2, 3)
        for module in model.features:
            if isinstance(module, nn.Conv2d):
                back = None if planes is self.image else GATE
                planes = add(self.encoder, Convolution(module, planes, RELU, back), module)
        row = add(self.encoder, Flatten(planes, allocate(1, model.mean.in_features)))
        heads = [model.mean, model.log_variance] if weights.beta else [model.mean]
        self.code = dense(self.encoder, row, PUT, GATE, *heads)  # mean of z_image, then its log-variance

        self.decoder: list[Layer] = []
        self.z_image = allocate(1, model.latent)
        if weights.alpha:
            (linear,) = (module for module in model.decode if isinstance(module, nn.Linear))
            row = dense(self.decoder, self.z_image, RELU, PUT, linear)
            planes = add(self.decoder, Flatten(row, allocate(*planes.shape[:-1])))
            transposed = [module for module in model.decode if isinstance(module, nn.ConvTranspose2d)]
            for module in transposed:
                mode = PUT if module is transposed[-1] else RELU
                planes = add(self.decoder, Convolution(module, planes, mode, GATE), module)
        self.decoded = planes  # as log-odds

        self.classifier: list[Layer] = []
        self.demos = rows = allocate(max(n), model.latent + model.path_numbers)  # z_image, z_theta
        linears = [module for module in model.classifier if isinstance(module, nn.Linear)]
        for module in linears:
            mode, back = PUT if module is linears[-1] else RELU, PUT if rows is self.demos else GATE
            rows = dense(self.classifier, rows, mode, back, module)
        self.logits = rows

        self.parameters = [own for layer in self.layers.values() for own in (layer.weight, layer.bias)]
        for name, tensor in self.tensors("value"):
            for lane, model in enumerate(models):
                tensor[..., lane] = model.get_parameter(name).detach().reshape(tensor.shape[:-1])

    def tensors(self, kind: str) -> Iterator[tuple[str, Float[Array, "*shape lane"]]]:
        """Yield each trained tensor's name and its `kind` (an attribute of Parameter), a view in torch's axis order."""
        for names, layer in self.layers.items():
            weights = np.split(getattr(layer.weight, kind).transpose(layer.axes), len(names))
            biases = np.split(getattr(layer.bias, kind), len(names))
            for name, weight, bias in zip(names, weights, biases, strict=True):
                yield f"{name}.weight", weight
                yield f"{name}.bias", bias

    @torch.no_grad()
    def hand_over(self, models: Sequence[BetaVae]) -> None:
        """Copy the lanes' weights into the models, first lane to first model."""
        for name, tensor in self.tensors("value"):
            for lane, model in enumerate(models):
                parameter = model.get_parameter(name)
                parameter.copy_(torch.from_numpy(tensor[..., lane]).reshape(parameter.shape))

    def gradient(self, images, z_theta, valid, noise) -> Float[Array, "3 lane"]:
        """Return the weighted terms of Eq. 1; leave their gradient in the parameters.

        images: uint8 (scene, 100, 100, 3, lane); z_theta: (scene, row, number, lane); valid: (scene, row, lane); noise:
        (scene, latent, lane).
        """

        def forward(layers: list[Layer]) -> None:
            for layer in layers:
                layer.forward()

        def backward(layers: list[Layer], scene: int) -> None:
            for layer in reversed(layers):
                layer.backward(scene)

        for parameter in self.parameters:
            parameter.gradient.fill(0)
        terms, latent = allocate(3), self.z_image.shape[1]
        mean, log_variance, logits = self.code[0, :latent], self.code[0, latent:], self.logits[:, 0]
        for scene, (image, paths, labels, draw) in enumerate(zip(images, z_theta, valid, noise, strict=True)):
            lanes.standardise(image, self.centre, self.factor, self.intensities, self.image)
            forward(self.encoder)
            deviation = np.exp(0.5 * log_variance) if self.beta else np.float32(0)
            self.z_image[0] = mean + draw * deviation
            self.demos[:, :latent], self.demos[:, latent:] = self.z_image, paths

            forward(self.classifier)
            terms[2] -= (self.gamma * log_expit(np.where(labels, logits, -logits))).sum(0)
            logits[:] = self.gamma * (expit(logits) - labels)
            backward(self.classifier, scene)
            slope = self.demos[:, :latent].sum(0)  # with respect to z_image

            if self.alpha:
                forward(self.decoder)
                lanes.squared_error(self.decoded, self.intensities, 2 * self.alpha, terms[:1])
                backward(self.decoder, scene)
                slope += self.z_image[0]

            if self.beta:
                variance = deviation**2
                terms[1] += 0.5 * self.beta * (mean**2 + variance - log_variance - 1).sum(0)
                log_variance[:] = 0.5 * (slope * draw * deviation + self.beta * (variance - 1))
                slope += self.beta * mean
            mean[:] = slope
            backward(self.encoder, scene)
        for layer in self.layers.values():
            if isinstance(layer, Dense):
                layer.finish()
        terms[0] *= self.alpha
        return terms


def fit_stack(*data, **settings) -> list[Float[Array, "point 5"]]:
    """Train up to `LANES` models as `fit_models`, by the gradient of `Stack`."""
    return fit_models(_descend, *data, **settings)


def _descend(weights, schedule, models, images, z_theta, valid, seeds, checkpoints) -> list[Float[Array, "point 5"]]:
    if len(models) > LANES:
        raise ValueError(f"{len(models)} models for a stack: it holds {LANES}")
    lane_models = [*range(len(models)), *[0] * (LANES - len(models))]  # unused lanes repeat the first model
    pixels = np.stack([images[i] for i in lane_models], -1)
    paths, labels = (np.stack([own[i] for i in lane_models], -1) for own in map(pad_demonstrations, (z_theta, valid)))
    paths = (paths.astype(np.float32) - Z_CENTRE) / Z_SCALE
    stack = Stack([models[i] for i in lane_models], weights, [valid[i].shape[1] for i in lane_models], len(pixels))
    generators = [torch.Generator().manual_seed(seed) for seed in seeds]

    def loss() -> Losses:
        noise = [torch.randn(len(pixels), models[0].latent, generator=generator).numpy() for generator in generators]
        terms = stack.gradient(pixels, paths, labels, np.stack([noise[i] for i in lane_models], -1))
        return None, list(torch.from_numpy(np.vstack([terms, terms.sum(0)])))

    hand_over = partial(stack.hand_over, models)
    parameters = [parameter.tensor for parameter in stack.parameters]
    curve = minimise(loss, parameters, schedule, partial(checkpoints.keep, models, hand_over))
    hand_over()
    return list(curve[..., : len(models)].transpose(2, 0, 1))
