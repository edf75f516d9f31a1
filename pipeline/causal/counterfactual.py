"""Attribution: which item caused the rejection of a path, for single scenes, paths and users.

The effect is V = 0. Its possible causes X_j are the presence of item j at its position. The noise of V is held fixed
(pipeline.causal.scm). The answer is a probability of causation of Tian and Pearl (2000; Pearl, 2009, Definition 9.2.1):

    PN_j = P(V_{O without j} = 1 | V = 0)             necessity: without j the path would be valid

A single cause has PN = 1. Under overdetermination two items each forbid the path: PN = 0 for both.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.causal.scm import chance_of_change
from pipeline.stats.crossed import Held, ratio
from pipeline.stats.scores import DECISION
from pipeline.world.layout import EMPTY, Layouts

NO_SINGLE_CAUSE = -1  # replaces a slot index
MIN_PAIRS = 30  # fewest pairs of seed and scene with a counted path for which an interval is given ...
MIN_SCENES = 10  # ... and fewest scenes (Cochran, 1977, Chapter 6)


@dataclass(frozen=True)
class Removals:
    """P(valid), or the true validity, in the versions of each scene.

    factual: the original scene; empty: without any item; without: without the item of each slot, for a free slot the
    original scene.
    """

    factual: Float[Array, "*b scene path"]
    empty: Float[Array, "*b scene path"]
    without: Float[Array, "*b scene path slot"]

    @property
    def necessity(self) -> Float[Array, "*b scene path slot"]:
        """Return PN_j; 0 in free slots, NaN if the path cannot be invalid."""
        return chance_of_change(False, self.factual[..., None], self.without)


@dataclass(frozen=True)
class Subsets:
    """The distinct versions of several scenes, without duplicates.

    scene, kept: each version's scene, and the items that remain in it; index: the version that answers each question
    (factual, empty, without each slot).
    """

    scene: Int[Array, " version"]
    kept: Bool[Array, "version slot"]
    index: Int[Array, "scene question"]

    def by_question(self, values: Float[Array, "*b version path"]) -> Removals:
        """Return the values of all versions, arranged by question."""
        arranged = np.moveaxis(np.asarray(values, dtype=np.float64)[..., self.index, :], -2, -1)  # question last
        return Removals(arranged[..., 0], arranged[..., 1], arranged[..., 2:])


def item_subsets(present: Bool[Array, "scene slot"]) -> Subsets:
    """Return the versions needed for scenes with items in the slots that are `present`.

    With one item, the scene without it is empty; such duplicates are listed once.
    """
    scenes, slots = present.shape
    masks = np.concatenate([np.ones((1, slots), bool), np.zeros((1, slots), bool), ~np.eye(slots, dtype=bool)])
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


def score_attributions(model: Removals, truth: Removals, chances: Mapping[str, Array], items: Held) -> dict[str, float]:
    """Return scores of the models' attributions (seed, scene, path) of truly rejected paths (scene, path).

    All scores refer to the paths that both model and truth reject. Without such paths only `rejected`, 0, is returned.

    - rejected: number of these paths per seed; recall: their share of all truly invalid paths; single: share with a
      single cause.
    - right: how often the model names the single cause; baseline_*: `right` of each baseline in `chances`.
    - empty_rejected: how often the model also rejects the path on the empty table.

    The interval of `right` is over seeds crossed with scenes, whose `items` are chance; NaN below MIN_PAIRS or
    MIN_SCENES.
    """
    cause, invalid = attribute(truth.necessity), np.broadcast_to(truth.factual == 0, model.factual.shape)
    rejected = invalid & (model.factual <= DECISION)
    if not rejected.any():
        return {"rejected": 0.0}
    single, right = rejected & (cause != NO_SINGLE_CAUSE), attribute(model.necessity) == cause
    scores = {"rejected": float(rejected.sum() / len(rejected)), "recall": float(rejected.sum() / invalid.sum())}
    scores |= {"single": float(single.sum() / rejected.sum()), "right": mean(right, single)}
    scores |= {"ci_low": np.nan, "ci_high": np.nan}
    count = single.sum(-1)  # (seed, scene)
    if (count > 0).sum() >= MIN_PAIRS and (count > 0).any(0).sum() >= MIN_SCENES:
        interval = ratio((single & right).sum(-1).astype(float)[None], count[None].astype(float), items)
        scores |= interval.row("right", "ci_low", "ci_high", share=True)
    scores |= {f"baseline_{name}": mean(chance, single) for name, chance in chances.items()}
    return scores | {"empty_rejected": mean(model.empty <= DECISION, rejected)}


def mean(values: Array, mask: Bool[Array, "*b"]) -> float:
    """Return the mean of `values`, broadcast to `mask`, where it is true; NaN if it is nowhere."""
    return float(np.broadcast_to(values, mask.shape)[mask].mean()) if mask.any() else np.nan
