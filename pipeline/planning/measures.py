"""Measure repairs: success rate, displacement and share of unsafe repairs (paper, Table 1: success rate)."""

import numpy as np
import pandas as pd

from pipeline.stats.crossed import quartiles, ratio

GROUP = ["method", "variant", "user"]
COLUMNS = [
    *GROUP, "seeds", "starts", "success", "success_q1", "success_q3", "success_ci_low", "success_ci_high",
    "displacement_ratio", "accepted", "unsafe",
]  # fmt: skip


def measures(repairs: pd.DataFrame) -> pd.DataFrame:
    """Return the measures of each method, variant and user, one row each, in the order of their first row.

    repairs: one row per start and seed (pipeline.artifacts.repairs). Columns of the result:
    seeds, starts (per seed);
    success: share of repaired paths that are truly valid, with quartiles over seeds and a 95 % interval over seeds
    crossed with scenes (NaN for a single scene);
    displacement_ratio: sum of displacements over the sum of displacements to the nearest valid paths;
    accepted: share of repaired paths with p > .5; unsafe: share of all starts accepted although truly invalid.
    The last two are NaN for baselines, which have no model.
    """
    measured = []
    for group, rows in repairs.groupby(GROUP, sort=False):
        accepted = rows["accepted"].to_numpy(dtype=float, na_value=np.nan)
        by_seed = rows.groupby("seed")["valid_end"].agg(["mean", "size"])
        success = quartiles(by_seed["mean"].to_numpy())
        ratio_to_nearest = float(rows["displacement_m"].sum() / rows["oracle_displacement_m"].sum())
        unsafe = float((accepted * ~rows["valid_end"].to_numpy(dtype=bool)).mean())
        measured.append((
            *group, len(by_seed), int(by_seed["size"].iloc[0]), success["mean"], success["q1"], success["q3"],
            *_interval(rows), ratio_to_nearest, float(accepted.mean()), unsafe,
        ))  # fmt: skip
    return pd.DataFrame(measured, columns=COLUMNS)


def _interval(rows: pd.DataFrame) -> tuple[float, float]:
    """Return the 95 % interval of the success rate, clipped to [0, 1]."""
    sums = rows.groupby(["seed", "scene"])["valid_end"].agg(["sum", "size"])
    successes, starts = (sums[name].unstack().to_numpy(dtype=float)[None] for name in ("sum", "size"))
    if starts.shape[2] < 2:
        return np.nan, np.nan
    estimate = ratio(successes, starts)
    return float(estimate.ci_low[0].clip(0, 1)), float(estimate.ci_high[0].clip(0, 1))
