"""Refuters: questions with a known true answer, so that a wrong answer refutes the effects (named as in DoWhy).

dummy_outcome      labels permuted before training: no effect expected
placebo_treatment  an added item's pixels shuffled in place: no effect expected
negative_control   only paths far from the added item: no effect expected
other_environment  the effect on another table top minus the effect on the original one: no difference expected
data_subset        random halves of the scenes: the verdict of all scenes expected
"""

from collections import Counter

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Shaped
from numpy import ndarray as Array

from pipeline.causal.interventions import estimate_effects
from pipeline.models.base import Images
from pipeline.stats.crossed import Effects, Held

DUMMY_OUTCOME, PLACEBO_TREATMENT = "dummy_outcome", "placebo_treatment"
NEGATIVE_CONTROL, OTHER_ENVIRONMENT, DATA_SUBSET = "negative_control", "other_environment", "data_subset"


def placebo_patch(rng: np.random.Generator, before: Images, after: Images, piece: int = 1) -> Images:
    """Return `after` with the pixels that differ from `before` shuffled within each scene.

    The patch keeps the item's outline, colours and contrast but shows no item. Squares of `piece` x `piece` pixels move
    as a whole if all of their pixels differ; the remaining pixels at the rim move one by one.
    """
    patched = before.copy()
    for image, old, new in zip(patched, before, after, strict=True):
        changed = (old != new).any(-1, keepdims=True)
        whole = _squares(changed, piece).all((2, 3, 4))
        rim = changed[..., 0] & ~np.kron(whole, np.ones((piece, piece), bool))
        _squares(image, piece)[whole] = rng.permutation(_squares(new, piece)[whole])
        image[rim] = rng.permutation(new[rim])
    return patched


def _squares(image: Shaped[Array, "row column channel"], side: int) -> Shaped[Array, "down across _ _ channel"]:
    """Return a view of an image as squares; `side` must divide its height and width."""
    rows, columns, channels = image.shape
    return image.reshape(rows // side, side, columns // side, side, channels).swapaxes(1, 2)


def mean_over_paths(p: Float[Array, "*#b path"], chosen: Bool[Array, "*#b path"]) -> Float[Array, "*b_all"]:
    """Return E[V] over the chosen paths only; NaN if none is chosen."""
    count = chosen.sum(-1)
    total = np.where(chosen, p, 0.0).sum(-1, dtype=np.float64)
    return np.divide(total, count, out=np.full(total.shape, np.nan), where=np.broadcast_to(count > 0, total.shape))


def data_subset(rng: np.random.Generator, effects: Effects, splits: int, items: Held) -> pd.DataFrame:
    """Return each question's results on random halves of the scenes, one row per question; `items` are chance.

    effect, ci_low, ci_high: mean and 2.5th and 97.5th percentile of the halves' effects; verdict: the most frequent
    one; expected: the verdict of all scenes; agreement: share of the halves with that verdict. No hypothesis is tested.
    """
    scenes = effects.shape[-1]
    parts = [rng.permutation(scenes)[: scenes // 2] for _ in range(splits)]
    halves = [estimate_effects(effects[..., part], items[:, part]) for part in parts]
    means = np.array([half["effect"] for half in halves])  # (split, question)
    verdicts = np.array([half["verdict"] for half in halves])
    low, high = np.quantile(means, (0.025, 0.975), axis=0)
    expected = estimate_effects(effects, items)["verdict"].to_numpy()
    most = [Counter(column).most_common(1)[0][0] for column in verdicts.T.tolist()]
    table = pd.DataFrame({"effect": means.mean(0), "ci_low": low, "ci_high": high, "verdict": most})
    return table.assign(expected=expected, agreement=(verdicts == expected).mean(0))
