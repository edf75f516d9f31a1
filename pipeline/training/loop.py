"""What every fit by gradient descent shares: its schedule, weights kept on the way, labels that say nothing."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from torch import Tensor, nn
from torch.optim import AdamW
from torch.optim.lr_scheduler import OneCycleLR


@dataclass(frozen=True)
class Schedule:
    """How long and how fast (conf/train, conf/path; conf/irl has more)."""

    steps: int  # one of the VAE's sees every demonstration once
    rate: float  # AdamW's peak learning rate; OneCycle warms up to it and anneals to nearly 0
    weight_decay: float
    curve_every: int  # steps between two points of the learning curve

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Schedule":
        """The schedule from conf/train or conf/path."""
        return cls(values["steps"], float(values["rate"]), float(values["weight_decay"]), values["curve_every"])

    def optimiser(self, parameters: Iterable[Tensor]) -> tuple[AdamW, OneCycleLR]:
        """AdamW of `parameters`, and what paces it: both take a step after every gradient."""
        optimiser = AdamW(parameters, lr=self.rate, weight_decay=self.weight_decay, fused=True)
        return optimiser, OneCycleLR(optimiser, self.rate, total_steps=self.steps)


class Checkpoints:
    """Weights of models as they were at some steps of their training, before that step's update."""

    def __init__(self, steps: Iterable[int] = ()):
        self.steps = frozenset(steps)
        self._states: list[tuple[nn.Module, int, dict[str, Array]]] = []

    def keep(self, step: int, *models: nn.Module) -> None:
        """Keep a copy of the models' parameters and buffers."""
        for model in models:
            state = {name: value.detach().cpu().numpy().copy() for name, value in model.state_dict().items()}
            self._states.append((model, step, state))

    def of(self, model: nn.Module) -> dict[int, dict[str, Array]]:
        """step -> the model's weights by name."""
        return {step: state for whose, step, state in self._states if whose is model}


def is_constant(valid: Bool[Array, "*demo"]) -> bool:
    """Whether demonstrations are all valid or all invalid: they say nothing about what changes validity."""
    return bool(valid.all() or not valid.any())


def rule_of_succession(valid: Bool[Array, "*demo"]) -> float:
    """Laplace's rule of succession: P(the next path is valid) = (valid + 1) / (all + 2)."""
    return (int(valid.sum()) + 1) / (valid.size + 2)


def padded(demos: Sequence[Array]) -> list[Array]:
    """Demonstrations (scene, n, ...) of several models in as many rows: a scene's first one again in those to spare."""
    rows = max(of_model.shape[1] for of_model in demos)
    return [np.concatenate([d, d[:, :1].repeat(rows - d.shape[1], 1)], 1) for d in demos]


def shares(n: Sequence[int]) -> Float[Array, "row model"]:
    """What each row of `padded` demonstrations counts in its scene's mean: 1 / n, or 0 to spare."""
    return np.where(np.arange(max(n))[:, None] < n, 1 / np.array(n), 0)
