"""The training loop of all models, with schedule, checkpoints, and stacking of models and demonstrations."""

import copy
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from torch import Tensor, nn
from torch.func import stack_module_state
from torch.optim import AdamW
from torch.optim.lr_scheduler import OneCycleLR

Model = TypeVar("Model", bound=nn.Module)

# The result of a loss function: the scalar to minimise (None: the gradients are already in the parameters), and
# the loss terms before this step, one curve column each: scalars, or one value per model.
Losses = tuple[Tensor | None, Sequence[Tensor]]


@dataclass(frozen=True)
class Schedule:
    """Length and speed of training (conf/train.yaml, conf/clearance.yaml; conf/irl.yaml extends it)."""

    steps: int  # optimiser steps
    rate: float  # AdamW's peak learning rate; OneCycle warms up to it and anneals to nearly 0
    weight_decay: float
    curve_every: int  # steps between two points of the learning curve
    adam_beta2: float = field(default=0.999, kw_only=True)  # decay of AdamW's mean squared gradient

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Schedule":
        """Return the schedule in conf/train.yaml or conf/clearance.yaml."""
        names = "steps", "rate", "weight_decay", "curve_every", "adam_beta2"
        return cls(**{name: values[name] for name in names if name in values})

    def optimiser(self, parameters: Iterable[Tensor]) -> tuple[AdamW, OneCycleLR]:
        """Return AdamW for `parameters` and its learning-rate schedule; step both after each gradient."""
        betas = 0.9, self.adam_beta2
        optimiser = AdamW(parameters, lr=self.rate, betas=betas, weight_decay=self.weight_decay, fused=True)
        return optimiser, OneCycleLR(optimiser, self.rate, total_steps=self.steps)


def minimise(
    loss: Callable[[], Losses | None],
    parameters: Iterable[Tensor],
    schedule: Schedule,
    *,
    before_step: Callable[[int], None] | None = None,
) -> Float[Array, "point column *model"]:
    """Minimise `loss` over `parameters` in `schedule.steps` steps; return the learning curve.

    A curve point is (step, *losses) before that step's update, every `curve_every` steps and at the last one. If `loss`
    returns None, the step changes no parameter and adds no point. `before_step` is called with each step's number.
    """
    optimiser, learning_rate = schedule.optimiser(parameters)
    points: list[tuple[int, list[Tensor]]] = []
    for step in range(schedule.steps):
        if before_step is not None:
            before_step(step)
        losses = loss()
        if losses is not None:
            objective, columns = losses
            if objective is not None:
                optimiser.zero_grad()
                objective.backward()
            optimiser.step()
            if step % schedule.curve_every == 0 or step == schedule.steps - 1:
                points.append((step, [column.detach().clone() for column in columns]))
        learning_rate.step()
    return np.array([_point(step, columns) for step, columns in points])


def _point(step: int, columns: Sequence[Tensor]) -> Array:
    """Return one curve point (column, *model)."""
    losses = torch.stack(list(columns)).cpu().numpy().astype(np.float64)
    return np.concatenate([np.full_like(losses[:1], step), losses])


class Checkpoints:
    """Copies of models' weights before selected steps of their training."""

    def __init__(self, steps: Iterable[int] = ()):
        self.steps = frozenset(steps)
        self._states: defaultdict[nn.Module, dict[int, dict[str, Array]]] = defaultdict(dict)

    def before_step(self, models: Sequence[nn.Module], update: Callable[[], object]) -> Callable[[int], None]:
        """Return `minimise`'s callback that keeps the models' weights, after `update` wrote them into the models."""

        def keep(step: int) -> None:
            if step in self.steps:
                update()
                for model in models:
                    state = model.state_dict().items()
                    self._states[model][step] = {name: value.detach().cpu().numpy().copy() for name, value in state}

        return keep

    def of(self, model: nn.Module) -> dict[int, dict[str, Array]]:
        """Return the model's parameters and buffers by name, for each kept step."""
        return self._states.get(model, {})


def stack_models(models: Sequence[Model]) -> Model:
    """Return a copy of the first model whose parameters and buffers are stacked over all models on the first axis."""
    parameters, buffers = stack_module_state(list(models))
    stacked = copy.deepcopy(models[0])
    for name, value in parameters.items():
        setattr(stacked, name, nn.Parameter(value.detach(), requires_grad=value.requires_grad))
    for name, value in buffers.items():
        setattr(stacked, name, value)
    return stacked


@torch.no_grad()
def unstack_models(parameters: Mapping[str, Tensor], models: Sequence[nn.Module]) -> None:
    """Copy each model's slice of the stacked parameters, by name, into the model."""
    for name, stacked in parameters.items():
        for model, value in zip(models, stacked.unbind(), strict=True):
            model.get_parameter(name).copy_(value)


def fit_sequentially(fit: Callable[..., Array], models, images, z_theta, valid, seeds, **settings) -> list[Array]:
    """Fit several models in sequence by `fit`(model, images, z_theta, valid, seed=, **settings)."""
    jobs = zip(models, images, z_theta, valid, seeds, strict=True)
    return [fit(*arguments, seed=seed, **settings) for *arguments, seed in jobs]


def is_constant(valid: Bool[Array, "*demo"]) -> bool:
    """Return whether all labels are equal, so that they carry no information on validity."""
    return bool(valid.all() or not valid.any())


def rule_of_succession(valid: Bool[Array, "*demo"]) -> float:
    """Return Laplace's P(the next path is valid) = (valid + 1) / (all + 2)."""
    return (int(valid.sum()) + 1) / (valid.size + 2)


def pad_demonstrations(demonstrations: Sequence[Array]) -> list[Array]:
    """Return several models' demonstrations (scene, n, ...) padded to equal n by repeating each scene's first one."""
    rows = max(array.shape[1] for array in demonstrations)
    return [np.concatenate([d, d[:, :1].repeat(rows - d.shape[1], 1)], 1) for d in demonstrations]


def row_weights(n_demos: Sequence[int]) -> Float[Array, "row model"]:
    """Return the weight of each padded row in its scene's mean: 1 / n for real rows, 0 for padding."""
    return np.where(np.arange(max(n_demos))[:, None] < n_demos, 1 / np.array(n_demos), 0)
