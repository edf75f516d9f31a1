"""Fit models of the paper with different settings side by side, one per SIMD lane.

The engine (pipeline.training.vae.engines.simd) shares weights of Eq. 1, rate and decay among its models. Here each lane
has its own, and its own dropout and augmentation; layers' sizes and scenes per step stay shared. A model's result does
not depend on the other lanes.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import zip_longest

import numpy as np
import torch
from jaxtyping import Float32, UInt8
from numpy import ndarray as Array
from torch import Tensor
from torch.optim import Optimizer
from torch.optim.lr_scheduler import OneCycleLR

from pipeline.models.vae.beta_vae import Z_CENTRE, Z_SCALE, BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.runtime.roots import square_root
from pipeline.runtime.streams import stream
from pipeline.training.irl.augment import ColorJitter
from pipeline.training.loop import Losses, Schedule, minimise, row_weights
from pipeline.training.refit import TrainingSet
from pipeline.training.vae.engines.simd import Stack
from pipeline.training.vae.engines.simd_kernels import LANES
from pipeline.training.vae.engines.simd_layers import Layer
from studies.search.augment import SYMMETRIES, appearances, turn_images, turn_paths


@dataclass(frozen=True)
class LaneSetting:
    """The settings that may differ between the models of a stack."""

    weights: Weights
    rate: float
    weight_decay: float
    dropout: float
    jitter: bool
    symmetries: bool


class PerLane(np.ndarray):
    """A weight of Eq. 1 for each lane. It is true if any is above 0: the engine asks whether it has the term."""

    def __bool__(self) -> bool:
        return bool(np.asarray(self).any())


class Dropout(Layer):
    """Multiply hidden units in place by `mask`: 0 if dropped, else 1 / (1 - p); (row, unit, lane)."""

    def __init__(self, y: Array):
        self.x = self.y = y
        self.mask = np.ones_like(y)

    def forward(self):
        self.y *= self.mask

    def backward(self, scene):
        self.x *= self.mask


class SettingsStack(Stack):
    """A stack whose lanes have settings of their own."""

    def __init__(self, models: Sequence[BetaVae], settings: Sequence[LaneSetting], n: int, scenes: int):
        super().__init__(models, settings[0].weights, [n] * len(models), scenes)
        beta, gamma = (np.array([getattr(s.weights, name) for s in settings]) for name in ("beta", "gamma"))
        self.beta = (beta / scenes).astype(np.float32).view(PerLane)
        self.gamma = (gamma / scenes * row_weights([n] * len(models))).astype(np.float32)  # (row, lane)
        self.drops = [Dropout(layer.y) for layer in self.classifier[:-1]]
        self.masks: Sequence[Float32[Array, "scene row unit lane"]] = ()  # of each dropout layer
        if any(s.dropout for s in settings):
            pairs = zip_longest(self.classifier, self.drops)
            self.classifier = [layer for pair in pairs for layer in pair if layer is not None]

    def _scene(self, scene: int, *inputs) -> None:
        for drop, mask in zip(self.drops, self.masks, strict=False):
            drop.mask = mask[scene]
        super()._scene(scene, *inputs)


class LaneAdamW(Optimizer):
    """AdamW with a rate and a decay for each lane: torch's has one for each tensor.

    The group's `lr` is a factor on all rates, which a schedule may set.
    """

    def __init__(
        self,
        tensors: Iterable[Tensor],
        rate: Float32[Tensor, " lane"],
        decay: Float32[Tensor, " lane"],
        betas: tuple[float, float],
    ):
        super().__init__(tensors, {"lr": 1.0, "betas": betas, "eps": 1e-8})
        self.rate, self.decay, self.count = rate, decay, 0

    @torch.no_grad()
    def step(self, closure=None):
        """Update all tensors (..., lane) from their gradients."""
        self.count += 1
        for group in self.param_groups:
            (beta1, beta2), rate = group["betas"], group["lr"] * self.rate
            for tensor in group["params"]:
                state = self.state[tensor]
                if not state:
                    state |= {"mean": torch.zeros_like(tensor), "square": torch.zeros_like(tensor)}
                mean = state["mean"].lerp_(tensor.grad, 1 - beta1)
                square = state["square"].mul_(beta2).addcmul_(tensor.grad, tensor.grad, value=1 - beta2)
                spread = square_root(square / (1 - beta2**self.count)).add_(group["eps"])
                tensor.mul_(1 - rate * self.decay)
                tensor.sub_(mean / spread * (rate / (1 - beta1**self.count)))


@dataclass(frozen=True)
class LaneSchedule(Schedule):
    """A schedule with the rates and decays of `settings`; its own are not used."""

    settings: Sequence[LaneSetting] = ()

    def optimiser(self, parameters: Iterable[Tensor]):
        """Return AdamW by lane and its one-cycle schedule."""
        rate, decay = (torch.tensor([getattr(s, name) for s in self.settings]) for name in ("rate", "weight_decay"))
        optimiser = LaneAdamW(parameters, rate, decay, (0.9, self.adam_beta2))
        return optimiser, OneCycleLR(optimiser, 1.0, total_steps=self.steps)


def fit_settings(
    models: Sequence[BetaVae],
    training_sets: Sequence[TrainingSet],
    settings: Sequence[LaneSetting],
    seeds: Sequence[int],
    schedule: Schedule,
    scenes_per_step: int,
    jitter: ColorJitter,
    n_augmentations: int,
    root_seed: int,
) -> None:
    """Train up to LANES models of one shape in place, each on its training set with its setting.

    All training sets have the same number of scenes and of demonstrations. ValueError for too many models.
    """
    if len(models) > LANES:
        raise ValueError(f"{len(models)} models for a stack: it holds {LANES}")
    for model, training_set in zip(models, training_sets, strict=True):
        model.standardise(training_set.images)
    lanes = [*range(len(models)), *[0] * (LANES - len(models))]  # unused lanes repeat the first model
    sets, of_lane = [training_sets[i] for i in lanes], [settings[i] for i in lanes]
    scenes, n = sets[0].valid.shape
    batch = min(scenes_per_step, scenes)
    looks, turned = _bank(sets, of_lane, jitter, n_augmentations)
    labels = np.stack([x.valid for x in sets], -1)
    stack = SettingsStack([models[i] for i in lanes], of_lane, n, batch)
    noises = [torch.Generator().manual_seed(seed) for seed in seeds]
    drop_streams = [stream(root_seed, "dropout", seed) for seed in seeds]
    draws = stream(root_seed, "scenes")  # the same for all lanes, so that none depends on its neighbours
    stack.masks = [np.ones((batch, *drop.y.shape), np.float32) for drop in stack.drops]

    def loss() -> Losses:
        scene = np.sort(draws.permutation(scenes)[:batch])
        look, symmetry = draws.integers(n_augmentations, size=batch) % len(looks[0]), int(draws.integers(SYMMETRIES))
        symmetry %= len(looks)
        for i, (setting, drops) in enumerate(zip(settings, drop_streams, strict=True)):
            for mask in stack.masks if setting.dropout else ():
                kept = drops.random(mask.shape[:-1], dtype=np.float32) >= setting.dropout
                mask[..., i] = kept / (1 - setting.dropout)
        drawn = [torch.randn(batch, models[0].latent, generator=noise).numpy() for noise in noises]
        noise = np.stack([drawn[i] for i in lanes], -1)
        with np.errstate(all="ignore"):  # a lane may diverge: its predictions are then not finite
            terms = stack.gradient(looks[symmetry][look, scene], turned[symmetry][scene], labels[scene], noise)
        return None, list(torch.from_numpy(np.vstack([terms, terms.sum(0)])))

    by_lane = LaneSchedule(schedule.steps, 1.0, 0.0, schedule.curve_every, of_lane, adam_beta2=schedule.adam_beta2)
    minimise(loss, [parameter.tensor for parameter in stack.parameters()], by_lane)
    stack.hand_over(models)
    for model in models:
        model.eval()


def _bank(
    sets: Sequence[TrainingSet], settings: Sequence[LaneSetting], jitter: ColorJitter, n_augmentations: int
) -> tuple[UInt8[Array, "symmetry appearance scene 100 100 3 lane"], Float32[Array, "symmetry scene row 2 lane"]]:
    """Return the images and the scaled paths of every lane, in every version that any lane is shown."""
    count = n_augmentations if any(s.jitter for s in settings) else 1
    symmetries = SYMMETRIES if any(s.symmetries for s in settings) else 1
    images = np.empty((symmetries, count, *sets[0].images.shape, LANES), np.uint8)
    paths = np.empty((symmetries, *sets[0].z_theta.shape, LANES), np.float32)
    for lane, (x, setting) in enumerate(zip(sets, settings, strict=True)):
        looks = appearances(x.images.tobytes(), count, jitter) if setting.jitter else x.images[None]
        for symmetry in range(symmetries):
            turn = symmetry if setting.symmetries else 0
            images[symmetry, ..., lane] = turn_images(looks, turn)
            paths[symmetry, ..., lane] = (turn_paths(x.z_theta, turn) - Z_CENTRE) / Z_SCALE
    return images, paths
