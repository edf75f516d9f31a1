"""Effects of an added item on E[V], from predictions in the same scenes without and with the item.

Predictions have an axis `version`: version 0 is the original scene, version 1 + k the scene with symbol k added.
A question is a pair of user and symbol; questions are ordered by user, then symbol.
"""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.causal.interventions import compare_with_truth
from pipeline.world.layout import SYMBOLS


def questions(users: Sequence[str]) -> pd.DataFrame:
    """Return the user and symbol of each question."""
    return pd.MultiIndex.from_product([list(users), SYMBOLS], names=["user", "symbol"]).to_frame(index=False)


def expected_by_version(
    p: Float[Array, "user seed version scene path"],
) -> tuple[Float[Array, "question seed scene"], Float[Array, "question seed scene"]]:
    """Return E[V], the mean of p over paths, without the item and with it."""
    expected = p.mean(-1, dtype=np.float64)
    after = np.moveaxis(expected[:, :, 1:], 2, 1)  # (user, symbol, seed, scene)
    before = np.broadcast_to(expected[:, None, :, 0], after.shape)
    return before.reshape(-1, *after.shape[2:]), after.reshape(-1, *after.shape[2:])


def added_item_effects(p: Float[Array, "user seed version scene path"]) -> Float[Array, "question seed scene"]:
    """Return E[V | do(Z_I := E(I + o)), S = s] - E[V | S = s] of each question (paper, second inequality)."""
    before, after = expected_by_version(p)
    return after - before


def verdicts(
    users: Sequence[str], p: Float[Array, "user seed version scene path"], valid: Bool[Array, "user version scene path"]
) -> pd.DataFrame:
    """Return user, symbol and the columns of `compare_with_truth` for each question; all questions form one family."""
    truth = (x[:, 0] for x in expected_by_version(valid[:, None].astype(float)))
    return pd.concat([questions(users), compare_with_truth(*expected_by_version(p), *truth)], axis=1)
