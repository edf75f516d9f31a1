"""Items as a source of chance: scenes to which the same item was added are no replications of one another.

What a model makes of an item, an outline seen too far out, say, it makes of it in every scene. Where an answer is meant
for other items of the symbol, too, an item counts once, however many scenes it was added to: the means of clusters are
the observations (Donner and Klar, 2000). And where all training sets hold the same few items of the symbol, what these
were like is in every answer, and no training set of other items is there to show it.
"""

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array


def by_item(values: Float[Array, "seed scene dose"], item: Int[Array, " scene"]) -> Float[Array, "seed item dose"]:
    """Mean over the scenes to which each item was added, NaN left out; NaN where nothing is left."""
    there = np.stack([item == i for i in np.unique(item)])[:, :, None] & ~np.isnan(values[0])  # (item, scene, dose)
    sums = np.einsum("sxd,ixd->sid", np.nan_to_num(values), there.astype(float))
    return np.where(there.any(1), sums / np.maximum(there.sum(1), 1), np.nan)


def as_from_other_items(values: Float[Array, "seed item"], trained: int) -> Float[Array, "seed item"]:
    """Values whose items lie further apart, by the chance of the `trained` items that all training sets share.

    Both are drawn from the items of the symbol: of a mean over n items, the variance over items is 1 / n + 1 / trained
    of one item's where training sets tell what they make of an item from how it differs from theirs. The mean stays.
    """
    of_item, n = values.mean(0), values.shape[1]
    return values + (np.sqrt(1 + n / trained) - 1) * (of_item - of_item.mean())
