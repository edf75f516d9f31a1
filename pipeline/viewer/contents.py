"""Data classes for the contents of a recording: one model with its training data and repairs, as plain arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.world.layout import Layouts

# values of `Repairs.outcomes`: in truth, and to the model
REJECTED, ACCEPTED, FALSELY_VALID, FALSELY_INVALID = range(4)


@dataclass(frozen=True)
class Demonstrations:
    """One user's demonstrations in a training scene.

    image: row 0 at the far edge; layout: this scene only; z: the fitted paths [m];
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
    """A new scene with the model's and the true validity, and the model's gradient repairs.

    predicted: P(valid) on `bezier.lattice(side)` as [y, x]; truth: the true validity on the same lattice;
    start: each repair's number in the scene; z: its path [m] at every step, including the invalid start;
    p: P(valid) at every step; slack: clearance in excess of the user's margins [m], inf without margins;
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
    def outcomes(self) -> UInt8[Array, "side side"]:
        """Return for each map cell whether it is valid, and whether the model (p > 0.5) is wrong about it."""
        accepted = self.predicted > 0.5
        wrong = np.where(accepted, FALSELY_VALID, FALSELY_INVALID)
        return np.where(accepted == self.truth, np.where(accepted, ACCEPTED, REJECTED), wrong).astype(np.uint8)

    @property
    def agreement(self) -> float:
        """Return the share of map cells on which model and truth agree."""
        return float(np.mean((self.predicted > 0.5) == self.truth))


@dataclass(frozen=True)
class Intervention:
    """do(Z_I := E(I + o)): an item added to the first new scene, and its effects.

    image, layout: the scene with the item in the last occupied slot; predicted, truth: maps as in `Repairs`;
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
    """The model's training: its losses, and maps of the first new scene.

    step, losses: the learning curve by term; by_n: the maps of models fitted to that many demonstrations per scene;
    by_step: this model's maps after that many training steps, including the last.
    """

    step: Int[Array, " step"]
    losses: Mapping[str, Float[Array, " step"]]
    by_n: Mapping[int, Float[Array, "side side"]]
    by_step: Mapping[int, Float[Array, "side side"]]


@dataclass(frozen=True)
class Run:
    """One model, its training data, and the scenes to show.

    margins: the user's margin for each symbol [m]; None: no margin. The recording names its sources: conf/'s profile,
    data (md5 of data/), root_seed of the scenes, parameters (YAML) of the fit.
    """

    variant: str
    user: str
    seed: int
    n_demos: int
    profile: str
    data: str
    root_seed: int
    parameters: str
    margins: Mapping[str, float | None]
    demonstrations: tuple[Demonstrations, ...]
    repairs: tuple[Repairs, ...]
    interventions: tuple[Intervention, ...]
    learning: Learning

    @property
    def name(self) -> str:
        """Return `{variant}-{user}-s{seed}`: the recording's file name and id."""
        return f"{self.variant}-{self.user}-s{self.seed}"

    @property
    def agreement(self) -> float:
        """Return the share of cells, over all shown maps, on which model and truth agree."""
        return float(np.mean([shown.agreement for shown in self.repairs]))

    @property
    def repaired(self) -> int:
        """Return the number of repairs shown."""
        return sum(len(shown.start) for shown in self.repairs)

    @property
    def repaired_validly(self) -> int:
        """Return the number of repairs whose end is truly valid."""
        return sum(int(shown.ends_valid.sum()) for shown in self.repairs)

    @property
    def unsafe(self) -> int:
        """Return the number of repairs whose end the model accepts although it is invalid."""
        return sum(int(((shown.p[:, -1] > 0.5) & ~shown.ends_valid).sum()) for shown in self.repairs)


def grouped(runs: Sequence[Run], name: str) -> dict[str, list[Run]]:
    """Return the runs of each user, or of each variant, in their original order."""
    names = dict.fromkeys(getattr(run, name) for run in runs)
    return {wanted: [run for run in runs if getattr(run, name) == wanted] for wanted in names}
