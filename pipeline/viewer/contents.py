"""What one recording shows: plain arrays of one model, its training data and its repairs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.world.layout import Layouts

RIGHT, FALSELY_VALID, FALSELY_INVALID = 0, 1, 2  # values of `Repairs.errors`


@dataclass(frozen=True)
class Demonstrations:
    """One user's demonstrations in a training scene.

    image: row 0 at the far edge; layout: of this scene alone; z: the fitted paths [m];
    samples: each demonstration's trajectory (sample, 4) as t [s], x, y, z [m].
    """

    scene: int
    image: UInt8[Array, "100 100 3"]
    layout: Layouts
    z: Float[Array, "demo 2"]
    valid: Bool[Array, " demo"]
    samples: tuple[Array, ...]


@dataclass(frozen=True)
class Repairs:
    """A new scene, the model's and the true validity in it, and the model's gradient repairs.

    predicted: P(valid) on `bezier.lattice(side)` as [y, x]; truth: the user's rule on the same lattice;
    start: each repair's number in the scene; z: its path [m] at every step, the invalid start first;
    p: P(valid) at every step; slack: how far [m] it stays outside the user's margins, inf without any;
    ends_valid: whether the last step is truly valid.
    """

    scene: int
    image: UInt8[Array, "100 100 3"]
    layout: Layouts
    predicted: Float[Array, "side side"]
    truth: Bool[Array, "side side"]
    start: tuple[int, ...]
    z: Float[Array, "repair step 2"]
    p: Float[Array, "repair step"]
    slack: Float[Array, "repair step"]
    ends_valid: Bool[Array, " repair"]

    @property
    def errors(self) -> UInt8[Array, "side side"]:
        """Whether the model (valid: p > 0.5) is right about each cell of the map, or how it errs."""
        accepted = self.predicted > 0.5
        errors = np.where(accepted, FALSELY_VALID, FALSELY_INVALID)
        return np.where(accepted == self.truth, RIGHT, errors).astype(np.uint8)

    @property
    def agreement(self) -> float:
        """The share of the cells of the map on which the model and the truth agree."""
        return float(np.mean(self.errors == RIGHT))


@dataclass(frozen=True)
class Intervention:
    """do(Z_I := E(I + o)): an item added to the first of the new scenes, and its effects.

    image, layout: the scene with the item, which is in the last slot taken; predicted, truth: maps as in `Repairs`;
    learned, true: the effect on E[V] in this scene; learned_mean, true_mean: the means over `scenes` scenes.
    """

    symbol: str
    image: UInt8[Array, "100 100 3"]
    layout: Layouts
    predicted: Float[Array, "side side"]
    truth: Bool[Array, "side side"]
    learned: float
    true: float
    learned_mean: float
    true_mean: float
    scenes: int


@dataclass(frozen=True)
class Learning:
    """The model's training: its losses, and maps of the first of the new scenes.

    step, losses: the learning curve by term; by_n: the maps of models fitted to that many demonstrations per scene;
    by_step: the maps of this model after that many training steps, the whole training last.
    """

    step: Int[Array, " step"]
    losses: Mapping[str, Float[Array, " step"]]
    by_n: Mapping[int, Float[Array, "side side"]]
    by_step: Mapping[int, Float[Array, "side side"]]


@dataclass(frozen=True)
class Run:
    """One model, its training data, and the scenes to look at.

    margins: what the user keeps clear of each symbol [m]; None: does not care. profile, data: conf/'s profile and the
    digest of the scenes, so that a recording names what it was made from.
    """

    variant: str
    user: str
    seed: int
    n_demos: int
    profile: str
    data: str
    margins: Mapping[str, float | None]
    demonstrations: tuple[Demonstrations, ...]
    repairs: tuple[Repairs, ...]
    interventions: tuple[Intervention, ...]
    learning: Learning

    @property
    def name(self) -> str:
        """`{variant}-{user}-s{seed}`: the recording's file and id."""
        return f"{self.variant}-{self.user}-s{self.seed}"

    @property
    def agreement(self) -> float:
        """The share of the cells of all maps shown on which the model and the truth agree."""
        return float(np.mean([shown.agreement for shown in self.repairs]))


def by_user(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """Return the runs of each user, users and runs in the order they come in."""
    return {user: [run for run in runs if run.user == user] for user in dict.fromkeys(run.user for run in runs)}
