"""What one recording shows: plain arrays of one model, its training data and its repairs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.world.layout import Layouts

RIGHT, FALSELY_VALID, FALSELY_INVALID = 0, 1, 2  # what a cell of `Repairs.errors` holds


@dataclass(frozen=True)
class Demonstrations:
    """A training scene and what one user showed in it.

    image: row 0 at the far edge; layout: this one scene; z: the fitted paths [m];
    samples: per demonstration the raw recording (sample, 4) as t [s], x, y, z [m].
    """

    scene: int
    image: UInt8[Array, "100 100 3"]
    layout: Layouts
    z: Float[Array, "demo 2"]
    valid: Bool[Array, " demo"]
    samples: tuple[Array, ...]


@dataclass(frozen=True)
class Repairs:
    """A scene the model has never seen, what it and the truth say there, and its repairs.

    predicted: P(valid) on `bezier.lattice(side)` as [y, x]; truth: the user's rule on the same lattice;
    z: each repair's path [m] over its steps, step 0 being the invalid start; p: P(valid) at each of them;
    slack: how far [m] each of them stays outside the user's margins, inf if the user does not care for any item;
    start: the start's number in the scene; ends_valid: whether the last step is valid by the truth.
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
        """What becomes of each cell of the map if the model calls it valid at p > 0.5."""
        called = self.predicted > 0.5
        return np.where(called == self.truth, RIGHT, np.where(called, FALSELY_VALID, FALSELY_INVALID)).astype(np.uint8)

    @property
    def agreement(self) -> float:
        """Share of the cells of the map on which the model and the truth agree."""
        return float(np.mean(self.errors == RIGHT))


@dataclass(frozen=True)
class Intervention:
    """do(Z_I := E(I + o)): an item more in the first of the run's new scenes, and what it changes.

    image, layout: the scene with the item, which stands in the last slot taken; predicted, truth: maps as in `Repairs`;
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
class Counterfactual:
    """A rejected path of a new scene, and what would become of it if one item were not there.

    without: the scene without each of its items; p, truth: P(valid) and validity as it stands, then without each;
    blamed, culprit: the item (its place among the scene's) whose absence the model, the truth, most lets the path
    become valid by; None if no single one does, or the path is valid as it is.
    """

    kind: str
    scene: int
    image: UInt8[Array, "100 100 3"]
    layout: Layouts
    z: Float[Array, "2"]
    without: UInt8[Array, "item 100 100 3"]
    p: Float[Array, " question"]
    truth: Bool[Array, " question"]
    blamed: int | None
    culprit: int | None


@dataclass(frozen=True)
class Learning:
    """How the model came about: its losses, and the map of the first of the new scenes on the way.

    step, losses: the training's curve by term; by_n: the maps of models fitted to as many demonstrations a scene;
    by_step: of this one after as many steps of its training, the whole training last.
    """

    step: Int[Array, " step"]
    losses: Mapping[str, Float[Array, " step"]]
    by_n: Mapping[int, Float[Array, "side side"]]
    by_step: Mapping[int, Float[Array, "side side"]]


@dataclass(frozen=True)
class Run:
    """One model: who it was fitted to and on what, and the scenes to look at."""

    variant: str
    user: str
    seed: int
    n: int
    margins: Mapping[str, float | None]  # what the user keeps clear of each symbol [m]; None: does not care
    demonstrations: tuple[Demonstrations, ...]
    repairs: tuple[Repairs, ...]
    interventions: tuple[Intervention, ...]
    counterfactuals: tuple[Counterfactual, ...]
    learning: Learning

    @property
    def name(self) -> str:
        """`{variant}-{user}-s{seed}`: the recording's file and id."""
        return f"{self.variant}-{self.user}-s{self.seed}"

    @property
    def agreement(self) -> float:
        """Share of the cells of all latent maps shown on which the model and the truth agree."""
        return float(np.mean([shown.agreement for shown in self.repairs]))


def by_user(runs: Sequence[Run]) -> dict[str, list[Run]]:
    """The runs of each user, users and runs in the order they come in."""
    return {user: [run for run in runs if run.user == user] for user in dict.fromkeys(run.user for run in runs)}
