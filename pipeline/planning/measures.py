"""What became of repairs: rates and lengths by seed, and how far other seeds and other scenes might move them."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy import ndarray as Array

from pipeline.stats.crossed import quartiles, ratio

MEASURES = (
    "success", "correct", "fooled", "abstained", "displacement_m", "displacement_ratio", "oracle_displacement_m",
)  # fmt: skip


def measures(rows: pd.DataFrame) -> dict[str, float]:
    """MEASURES of one method, user and seed, from the rows of stages repair or search.

    success: the share of ends that are truly valid, accepted or not. An end is accepted (p > .5) and correct,
    accepted and fooled, or abstained from: the three sum to 1 (a reference accepts nothing itself: NaN).
    displacement_ratio: the mean displacement over the oracle's mean, both over all starts, so that no start
    close to the boundary blows it up.
    """
    right = rows["valid_end"].to_numpy(dtype=float)
    accepted = rows["accepted"].to_numpy(dtype=float, na_value=np.nan)
    moved, least = (rows[name].to_numpy().mean() for name in ("displacement_m", "oracle_displacement_m"))
    values = (right, accepted * right, accepted * (1 - right), 1 - accepted, moved, moved / least, least)
    return {name: float(np.mean(value)) for name, value in zip(MEASURES, values, strict=True)}


def summary(by_seed: Sequence[pd.DataFrame]) -> dict:
    """Of one method and user, a table a seed: each of MEASURES, mean over seeds and quartiles (`_q1`, `_q3`).

    `success_ci` and `fooled_ci`: 95 % intervals over seeds crossed with scenes; None for a single scene.
    `displacement_ratio_valid`: the displacement of the ends that are valid over their own least; None without any.
    """
    found, out = pd.DataFrame([measures(rows) for rows in by_seed]), {}
    for name in MEASURES:
        spread = quartiles(found[name].to_numpy())
        out |= {name: spread["mean"], f"{name}_q1": spread["q1"], f"{name}_q3": spread["q3"]}
    rows = pd.concat(by_seed, ignore_index=True)
    valid, accepted = rows["valid_end"].to_numpy(), rows["accepted"].to_numpy(dtype=bool)
    moved, least = (rows[name].to_numpy()[valid].sum() for name in ("displacement_m", "oracle_displacement_m"))
    return out | {
        "success_ci": _interval(rows, valid),
        "fooled_ci": _interval(rows, accepted & ~valid),
        "displacement_ratio_valid": float(moved / least) if valid.any() else None,
    }


def by_threshold(by_seed: Sequence[pd.DataFrame], thresholds: Sequence[float]) -> list[dict[str, float | None]]:
    """What is accepted if an end's P(valid) has to exceed each threshold, and how much of that is invalid.

    `accepted` and `fooled` are shares of all starts, `invalid` of those accepted: None if there are none.
    """
    rows = pd.concat(by_seed, ignore_index=True)
    p, valid = rows["p_end"].to_numpy(), rows["valid_end"].to_numpy()
    out = []
    for threshold in thresholds:
        accepted = p > threshold
        invalid = float((~valid[accepted]).mean()) if accepted.any() else None
        fooled = float((accepted & ~valid).mean())
        out.append({"above": threshold, "accepted": float(accepted.mean()), "fooled": fooled, "invalid": invalid})
    return out


def _interval(rows: pd.DataFrame, counted: Array) -> list[float] | None:
    """Of the share of the starts that is `counted`."""
    sums = rows.assign(part=counted, whole=1).groupby(["seed", "scene"])[["part", "whole"]].sum()
    parts, wholes = (sums[name].unstack().to_numpy(dtype=float)[None] for name in ("part", "whole"))
    if parts.shape[2] < 2:
        return None
    e = ratio(parts, wholes)
    return [float(np.clip(bound[0], 0, 1)) for bound in (e.ci_low, e.ci_high)]
