"""Paths as rows of demonstrations.csv: thinned, named, and described to the page."""

import hashlib
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.own.files import is_printable, normal
from pipeline.runtime.errors import InputError

MIN_STEP_S = 0.008  # between stored samples; some pens report 240 a second
MAX_NAME = 60  # characters of a person's name
FORMULA = "=+-@"  # a spreadsheet runs a cell that begins so


def tidy_name(name: str) -> str:
    """Return a name without needless spaces; raise InputError for one that a csv file should not hold."""
    name = normal(name)
    if not 1 <= len(name) <= MAX_NAME:
        raise InputError(f"the person’s name has {len(name)} characters: expected 1 to {MAX_NAME}")
    if name[0] in FORMULA or not is_printable(name):
        raise InputError(
            f"the person’s name {name!r} would be a formula in a spreadsheet, or cannot be printed: change it"
        )
    return name


def described(rows: pd.DataFrame) -> dict[str, Any]:
    """Return what the page shows of a path."""
    user, demo, word = rows[["user", "demo", "valid"]].iloc[0]
    return {"id": identity(rows), "user": user, "demo": demo, "valid": word.lower() == "true" if word else None}


def identity(rows: pd.DataFrame) -> str:
    """Return a name that changes with the content of these rows, so that nobody removes what they have not seen."""
    return hashlib.sha256(repr(rows.to_numpy().tolist()).encode()).hexdigest()[:16]


def thinned(samples: Float[Array, "n 3"]) -> Float[Array, "kept 3"]:
    """Return the first sample in each MIN_STEP_S, and the path's end."""
    _, kept = np.unique((samples[:, 0] - samples[0, 0]) // (1000 * MIN_STEP_S), return_index=True)
    return samples[[*kept[:-1], len(samples) - 1]]
