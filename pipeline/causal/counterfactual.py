"""Attribution: which item caused the rejection of a path, for single scenes, paths and users.

The effect is V = 0. Its possible causes X_j are the presence of item j at its position. The noise of V is held fixed
(pipeline.causal.scm). The answers are the probabilities of causation of Tian and Pearl (2000; Pearl, 2009, Definitions
9.2.1 and 9.2.2):

    PN_j = P(V_{O without j} = 1 | V = 0)             necessity: without j the path would be valid
    PS_j = P(V_{j alone} = 0 | V_{empty table} = 1)   sufficiency: j on an empty table makes the path invalid

PN refers to the original scene, PS to the scene without all other items. A single cause has PN = PS = 1. Under
overdetermination two items each forbid the path: PN = 0 and PS = 1 for both.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from numpy import ndarray as Array

from pipeline.causal.scm import chance_of_change
from pipeline.stats.crossed import ratio
from pipeline.stats.scores import DECISION
from pipeline.world.layout import EMPTY, Layouts

NO_SINGLE_CAUSE = -1  # replaces a slot index
MIN_PAIRS = 30  # fewest pairs of seed and scene with a counted path for which an interval is given ...
MIN_SCENES = 10  # ... and fewest scenes (Cochran, 1977, Chapter 6)


@dataclass(frozen=True)
class Removals:
    """P(valid), or the true validity, in four versions of each scene.

    factual: the original scene; empty: without any item; without: without the item of each slot; alone: with only that
    item. For a free slot, "without" is the original scene and "alone" the empty table.
    """

    factual: Float[Array, "*b scene path"]
    empty: Float[Array, "*b scene path"]
    without: Float[Array, "*b scene path slot"]
    alone: Float[Array, "*b scene path slot"]

    @property
    def necessity(self) -> Float[Array, "*b scene path slot"]:
        """Return PN_j; 0 in free slots, NaN if the path cannot be invalid."""
        return chance_of_change(False, self.factual[..., None], self.without)

    @property
    def sufficiency(self) -> Float[Array, "*b scene path slot"]:
        """Return PS_j; 0 in free slots, NaN if the path cannot be valid on the empty table."""
        return chance_of_change(True, self.empty[..., None], self.alone)

    def of_seed(self, seed: int) -> "Removals":
        """Return the values of one seed (first axis)."""
        return Removals(self.factual[seed], self.empty[seed], self.without[seed], self.alone[seed])


@dataclass(frozen=True)
class Subsets:
    """The distinct versions of several scenes, without duplicates.

    scene, kept: each version's scene, and the items that remain in it; index: the version that answers each question
    (factual, empty, without each slot, each slot alone).
    """

    scene: Int[Array, " version"]
    kept: Bool[Array, "version slot"]
    index: Int[Array, "scene question"]

    def by_question(self, values: Float[Array, "*b version path"]) -> Removals:
        """Return the values of all versions, arranged by question."""
        arranged = np.moveaxis(np.asarray(values, dtype=np.float64)[..., self.index, :], -2, -1)  # question last
        return Removals(**self._parts(arranged))

    def select_scenes(self, values: Array, scenes: list[int]) -> dict[str, Array]:
        """Return the values for each question of these scenes, given one value (such as an image) per version."""
        return {name: values[part] for name, part in self._parts(self.index[scenes]).items()}

    def _parts(self, x: Shaped[Array, "*b question"]) -> dict[str, Array]:
        first = 2 + self.kept.shape[1]
        return {"factual": x[..., 0], "empty": x[..., 1], "without": x[..., 2:first], "alone": x[..., first:]}


def item_subsets(present: Bool[Array, "scene slot"]) -> Subsets:
    """Return the versions needed for scenes with items in the slots that are `present`.

    With two items, the scene without one equals the other item alone; such duplicates are listed once.
    """
    scenes, slots = present.shape
    one = np.eye(slots, dtype=bool)
    masks = np.concatenate([np.ones((1, slots), bool), np.zeros((1, slots), bool), ~one, one])  # (question, slot)
    kept = present[:, None] & masks  # (scene, question, slot)
    scene = np.broadcast_to(np.arange(scenes)[:, None, None], (*kept.shape[:2], 1))
    rows = np.concatenate([scene, kept], axis=-1).reshape(-1, 1 + slots)
    versions, index = np.unique(rows, axis=0, return_inverse=True)
    return Subsets(versions[:, 0], versions[:, 1:].astype(bool), index.reshape(scenes, -1))


def select_items(layouts: Layouts, kept: Bool[Array, "scene slot"]) -> Layouts:
    """Return the same scenes with only the items in the `kept` slots."""
    return replace(layouts, item=np.where(kept, layouts.item, EMPTY), symbol=np.where(kept, layouts.symbol, EMPTY))


def attribute(necessity: Float[Array, "*b slot"]) -> Int[Array, "*b"]:
    """Return the slot with the largest PN; NO_SINGLE_CAUSE if it is tied or zero."""
    largest = necessity.max(-1, keepdims=True)
    single = (largest[..., 0] > 0) & ((necessity == largest).sum(-1) == 1)
    return np.where(single, necessity.argmax(-1), NO_SINGLE_CAUSE)


def baselines(
    cause: Int[Array, "scene path"], present: Bool[Array, "scene slot"], clearances: Float[Array, "scene path slot"]
) -> dict[str, Float[Array, "scene path"]]:
    """Return the probability that attribution without a model names the true cause; 0 if there is none.

    random_item: any item of the scene. nearest_item: the item with the smallest clearance [m].
    """
    caused = cause != NO_SINGLE_CAUSE
    random = caused / np.maximum(present.sum(-1, keepdims=True), 1)
    nearest = (caused & (cause == clearances.argmin(-1))).astype(float)
    return {"random_item": random, "nearest_item": nearest}


def score_attributions(model: Removals, truth: Removals, chances: Mapping[str, Array]) -> dict[str, float]:
    """Return scores of the models' attributions (seed, scene, path) of truly rejected paths (scene, path).

    All scores refer to the paths that both model and truth reject. Without such paths only `rejected`, 0, is returned.

    - rejected: number of these paths per seed; recall: their share of all truly invalid paths; single: share with a
      single cause.
    - right: how often the model names the single cause; baseline_*: `right` of each baseline in `chances`.
    - overdetermined_right: without a single cause, how often PN and PS of all items are on the right side of 1/2.
    - empty_rejected: how often the model also rejects the path on the empty table.

    Intervals (ci_low and ci_high of `right`, overdetermined_right_ci_*) are those of `mean_with_interval`.
    """
    cause, invalid = attribute(truth.necessity), np.broadcast_to(truth.factual == 0, model.factual.shape)
    rejected = invalid & (model.factual <= DECISION)
    if not rejected.any():
        return {"rejected": 0.0}
    single, several = rejected & (cause != NO_SINGLE_CAUSE), rejected & (cause == NO_SINGLE_CAUSE)
    same_side = (model.sufficiency > DECISION) == (truth.sufficiency > DECISION)
    as_true = (same_side & (model.necessity <= DECISION)).all(-1)
    scores = {"rejected": float(rejected.sum() / len(rejected)), "recall": float(rejected.sum() / invalid.sum())}
    scores |= {"single": float(single.sum() / rejected.sum())}
    right = mean_with_interval("right", attribute(model.necessity) == cause, single)
    scores |= {name.removeprefix("right_"): value for name, value in right.items()}
    scores |= {f"baseline_{name}": mean(chance, single) for name, chance in chances.items()}
    scores |= mean_with_interval("overdetermined_right", as_true, several)
    return scores | {"empty_rejected": mean(model.empty <= DECISION, rejected)}


def mean(values: Array, mask: Bool[Array, "*b"]) -> float:
    """Return the mean of `values`, broadcast to `mask`, where it is true; NaN if it is nowhere."""
    return float(np.broadcast_to(values, mask.shape)[mask].mean()) if mask.any() else np.nan


def mean_with_interval(name: str, values: Array, mask: Bool[Array, "seed scene *b"]) -> dict[str, float]:
    """Return `mean` and its 95 % interval over seeds crossed with scenes; shares are clipped to [0, 1].

    The bounds, `name`_ci_low and `name`_ci_high, are NaN below MIN_PAIRS or MIN_SCENES.
    """
    axes, ends = tuple(range(2, mask.ndim)), np.full(2, np.nan)
    count = mask.sum(axes)  # (seed, scene)
    if (count > 0).sum() >= MIN_PAIRS and (count > 0).any(0).sum() >= MIN_SCENES:
        e = ratio(np.where(mask, values, 0.0).sum(axes)[None], count[None].astype(float))
        ends = np.array([e.ci_low[0], e.ci_high[0]])
        ends = ends.clip(0, 1) if values.dtype == bool else ends
    low, high = ends.tolist()
    return {name: mean(values, mask), f"{name}_ci_low": low, f"{name}_ci_high": high}
