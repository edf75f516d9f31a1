"""Which users, scenes and repairs are shown."""

import numpy as np
import pandas as pd

from pipeline.artifacts.scenes import SceneSet
from pipeline.errors import InputError
from pipeline.report.results import Results
from pipeline.table.layout import SYMBOLS


def with_something_invalid(results: Results) -> list[str]:
    """The users to whom some path is invalid."""
    return [u for u in results.users if results.repair[results.main][u]["success"] is not None]


def most_varied(scenes: SceneSet, pool: str, count: int) -> np.ndarray:
    """The `count` scenes of a pool with the most symbols, then the most items; the first ones if tied."""
    layouts = scenes.layouts[pool]
    there = (layouts.symbol[..., None] == np.arange(len(SYMBOLS))) & layouts.present[..., None]  # (scene, slot, symbol)
    return np.lexsort((-layouts.present.sum(1), -there.any(1).sum(1)))[:count]


def repairs_of(frame: pd.DataFrame, paths: dict, variant: str, user: str, seed: int) -> tuple[pd.DataFrame, np.ndarray]:
    """A model's rows of repairs.parquet and of paths.npz, (start, point, 2) [m], which have the same order."""
    rows = frame[(frame["user"] == user) & (frame["method"] == variant)].reset_index(drop=True)
    key = f"{variant}-{user}-s{seed}"
    if key not in paths or len(paths[key]) != len(rows):
        raise InputError(f"paths.npz does not hold the {len(rows)} repairs of {key}: run the repair stage again")
    return rows, paths[key]
