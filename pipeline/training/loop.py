"""Fitting models: training sets, one training loop with schedule and checkpoints, and how each variant is fitted."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from pydantic import Field
from torch import Tensor, nn
from torch.optim import AdamW
from torch.optim.lr_scheduler import OneCycleLR

from pipeline.models.base import ValidityModel, untrained
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Count, Group, Size, Weight

MIN_OWN_DEMONSTRATIONS = 0.995  # share judged right that a converged model reaches
# The result of a loss function: the scalar to minimise (None: the gradients are already in the parameters), and
# the loss terms before this step, one curve column each: scalars, or one value per model.
Losses = tuple[Tensor | None, Sequence[Tensor]]


class Schedule(Group):
    """Length and speed of training (conf/train.yaml, conf/clearance.yaml; conf/irl.yaml extends it)."""

    steps: Count  # optimiser steps
    rate: Size  # AdamW's peak learning rate; OneCycle warms up to it and anneals to nearly 0
    weight_decay: Weight
    curve_every: Count  # steps between two points of the learning curve
    adam_beta2: Annotated[float, Field(ge=0, lt=1)] = 0.999  # decay of AdamW's mean squared gradient


class Checkpoints:
    """Copies of models' weights before selected steps of their training."""

    def __init__(self, steps: Iterable[int] = ()):
        self.steps = frozenset(steps)
        self._states: dict[nn.Module, dict[int, dict[str, Array]]] = {}

    def keep(self, models: Sequence[nn.Module], update: Callable[[], object], step: int) -> None:
        """Copy the models' weights before a selected step, after `update` wrote them into the models."""
        if step in self.steps:
            update()
            for model in models:
                state = {name: value.detach().cpu().numpy().copy() for name, value in model.state_dict().items()}
                self._states.setdefault(model, {})[step] = state

    def of(self, model: nn.Module) -> dict[int, dict[str, Array]]:
        """Return the model's parameters and buffers by name, for each kept step."""
        return self._states.get(model, {})


def minimise(
    loss: Callable[[], Any], parameters: Iterable[Tensor], schedule: Schedule, before_step: Callable = lambda _: None
) -> Float[Array, "point column *model"]:
    """Minimise `loss` over `parameters` in `schedule.steps` steps; return the learning curve.

    A curve point is (step, *losses) before that step's update, every `curve_every` steps and at the last one. If `loss`
    returns None, the step changes no parameter and adds no point. `before_step` is called with each step's number.
    """
    rate, betas = schedule.rate, (0.9, schedule.adam_beta2)
    optimiser = AdamW(parameters, lr=rate, betas=betas, weight_decay=schedule.weight_decay, fused=True)
    learning_rate = OneCycleLR(optimiser, rate, total_steps=schedule.steps)
    points: list[Array] = []
    for step in range(schedule.steps):
        before_step(step)
        if (losses := loss()) is not None:
            objective, columns = losses
            if objective is not None:
                optimiser.zero_grad()
                objective.backward()
            optimiser.step()
            if step % schedule.curve_every == 0 or step == schedule.steps - 1:
                values = torch.stack([column.detach() for column in columns]).cpu().numpy().astype(np.float64)
                points.append(np.concatenate([np.full_like(values[:1], step), values]))
        learning_rate.step()
    return np.array(points)


@torch.no_grad()
def unstack_models(parameters: Mapping[str, Tensor], models: Sequence[nn.Module]) -> None:
    """Copy each model's slice of the stacked parameters, by name, into the model."""
    for name, stacked in parameters.items():
        for model, value in zip(models, stacked.unbind(), strict=True):
            model.get_parameter(name).copy_(value)


def pad_demonstrations(demonstrations: Sequence[Array]) -> list[Array]:
    """Return several models' demonstrations (scene, n, ...) padded to equal n by repeating each scene's first one."""
    rows = max(array.shape[1] for array in demonstrations)
    return [np.concatenate([d, d[:, :1].repeat(rows - d.shape[1], 1)], 1) for d in demonstrations]


def row_weights(n_demos: Sequence[int]) -> Float[Array, "row model"]:
    """Return the weight of each padded row in its scene's mean: 1 / n for real rows, 0 for padding."""
    return np.where(np.arange(max(n_demos))[:, None] < n_demos, 1 / np.array(n_demos), 0)


def is_constant(valid: Bool[Array, "*demo"]) -> bool:
    """Return whether all labels are equal, so that they carry no information on validity."""
    return bool(valid.all() or not valid.any())


def rule_of_succession(valid: Bool[Array, "*demo"]) -> float:
    """Return Laplace's P(the next path is valid) = (valid + 1) / (all + 2)."""
    return (int(valid.sum()) + 1) / (valid.size + 2)


def fit_varied(descend, set_constant, models, images, z_theta, valid, seeds, checkpoints=None) -> list[Array]:
    """Train models in place, each on its demonstrations, by one call of `descend`; return curves (point, column).

    images, z_theta and valid of each model: as of a `TrainingSet`, with its own number of demonstrations a scene.
    A model with equal labels stays untrained: `set_constant`(model, P) makes it answer Laplace's P(valid) for every
    path, and returns the losses in its curve's only point. `checkpoints` keeps the others' weights on the way.
    """
    curves: dict[int, Array] = {}
    for i, (model, labels) in enumerate(zip(models, valid, strict=True)):
        if is_constant(labels):
            curves[i] = np.array([[0.0, *set_constant(model, rule_of_succession(labels))]])
    if varied := [i for i in range(len(models)) if i not in curves]:
        data = ([values[i] for i in varied] for values in (models, images, z_theta, valid, seeds))
        curves |= zip(varied, descend(*data, checkpoints or Checkpoints()), strict=True)
    return [curves[i] for i in range(len(models))]


@dataclass(frozen=True)
class TrainingSet:
    """One user's demonstrations in one seed's scenes: the data that one model is fitted to."""

    user: str
    seed: int
    images: UInt8[Array, "scene 100 100 3"]
    z_theta: Float[Array, "scene n 2"]  # [m]
    valid: Bool[Array, "scene n"]


class Trainer(NamedTuple):
    """Say how the models of one variant are fitted."""

    kind: type[ValidityModel]
    fit: Callable[..., list[Array]]  # (models, images, z_theta, valid, seeds=, checkpoints=) -> curves; must pickle
    columns: tuple[str, ...]  # of a learning curve, the first one `step`
    batch_size: int | None  # models per call of `fit`; None: any number, in sequence

    def fit_new(
        self,
        variant: str,
        shape: Mapping[str, Any],
        training_sets: Sequence[TrainingSet],
        seeds: Sequence[int],
        checkpoints: Checkpoints | None = None,
    ) -> tuple[list[ValidityModel], list[Float[Array, "point column"]]]:
        """Fit a new model of this `shape` to each training set; return the models and their learning curves.

        Raises InputError, naming the model, if a loss diverges. `seeds` decide initial weights and training.
        """
        models = [untrained(self.kind, shape, seed) for seed in seeds]
        data = ([getattr(t, name) for t in training_sets] for name in ("images", "z_theta", "valid"))
        curves = self.fit(models, *data, seeds=seeds, checkpoints=checkpoints)
        for t, curve in zip(training_sets, curves, strict=True):
            need_finite(curve, f"{variant} of {t.user}, seed {t.seed}, n_demos {t.valid.shape[1]}")
        return models, curves


def need_finite(curve: Float[Array, "point column"], model: str) -> None:
    """Raise InputError, naming the `model`, if its learning curve diverged; column 0: step."""
    if not np.isfinite(curve).all():
        step = int(curve[~np.isfinite(curve).all(1)][0, 0])
        raise InputError(f"{model}: its loss is no longer finite at step {step}; lower the learning rate of its stage")


def convergence(model: ValidityModel, training_set: TrainingSet, has_decoder: bool = True) -> dict[str, Any]:
    """Return whether the model reconstructs its training images and judges its own demonstrations right.

    `passed` if reconstruction_over_flat is below 1 and own_demonstrations at least MIN_OWN_DEMONSTRATIONS. The encoder
    of constant labels is never trained: no ratio.
    """
    trained = has_decoder and not is_constant(training_set.valid)
    ratio = model.reconstruction_over_flat(training_set.images) if trained else np.nan
    share = float(((model.probability(training_set.images, training_set.z_theta) > 0.5) == training_set.valid).mean())
    passed = share >= MIN_OWN_DEMONSTRATIONS and not ratio >= 1
    return {"reconstruction_over_flat": ratio, "own_demonstrations": share, "passed": passed}
