"""Items as a source of chance: scenes that share an added item are not independent replicates.

A model's error on an item, such as an outline detected too wide, recurs in every scene with that item. If a result is
to hold for other items of the symbol, each item counts once: cluster means are the observations (Donner and Klar,
2000). If all training sets share the same few items, these are a further source of chance.
"""

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray as Array


def by_item(values: Float[Array, "seed scene dose"], item: Int[Array, " scene"]) -> Float[Array, "seed item dose"]:
    """Return the mean over the scenes of each added item, ignoring NaN; NaN if no value remains."""
    members = np.stack([item == i for i in np.unique(item)])[:, :, None] & ~np.isnan(values[0])  # (item, scene, dose)
    sums = np.einsum("sxd,ixd->sid", np.nan_to_num(values), members.astype(float))
    return np.where(members.any(1), sums / np.maximum(members.sum(1), 1), np.nan)


def inflate_item_variance(values: Float[Array, "seed item"], n_training: int) -> Float[Array, "seed item"]:
    """Return the values with deviations between items inflated for the variance of the `n_training` items of all seeds.

    Added and training items are drawn from the items of the symbol. We assume that a model's error on an item depends
    on its difference from the training items. The variance over items of a mean over n items is then
    1 / n + 1 / n_training of a single item's. The mean is unchanged.
    """
    by_item, n = values.mean(0), values.shape[1]
    return values + (np.sqrt(1 + n / n_training) - 1) * (by_item - by_item.mean())
