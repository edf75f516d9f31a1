"""The effects that stage intervene measured, as arrays."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.artifacts.files import read_table
from pipeline.runtime.errors import InputError

COLUMNS = ["variant", "seed", "user", "scene", "symbol", "effect", "true_effect"]


def read_effects(
    directory: Path, variants: Sequence[str], users: Sequence[str], column: str = "effect"
) -> dict[str, Float[Array, "cell seed scene"]]:
    """Each variant's effects of every user and symbol (cells in alphabetical order), placements averaged.

    column: `effect`, or `true_effect`, which no seed changes. InputError if a variant's of a user are missing.
    """
    table = read_table(directory / "effects.parquet", COLUMNS)
    seeds, out = table["seed"].nunique(), {}
    for variant in variants:
        rows = table[(table["variant"] == variant) & table["user"].isin(list(users))]
        if lacking := set(users) - set(rows["user"]):
            raise InputError(
                f"{directory / 'effects.parquet'} lacks {variant} of {', '.join(sorted(lacking))}: run the intervene "
                "stage again"
            )
        wide = rows.pivot_table(index=["user", "symbol"], columns=["seed", "scene"], values=column)
        out[variant] = np.asarray(wide).reshape(len(wide), seeds, -1)
    return out
