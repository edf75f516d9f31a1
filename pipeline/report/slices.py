"""Judged paths: each model's prediction beside what the path is like, and scores by slices of them."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy import ndarray as Array

from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import Margins, clearance, slack

DISTANCES = (0.0, 0.01, 0.02, 0.04, 0.08, np.inf)  # edges of the slices by distance to the boundary [m]
DISTANCE_LABELS = ["0 to 1 cm", "1 to 2 cm", "2 to 4 cm", "4 to 8 cm", "over 8 cm"]
NOTHING = "nothing to avoid"  # slice of paths in scenes without an item that the user avoids
SLICES = {"user": "user", "nearest": "kind of item nearest", "items": "items on the table", "table_top": "table top",
          "distance": "distance to the boundary"}  # fmt: skip

OVERLAP = ("source", "both", "first", "second", "neither", "overlap_found", "overlap_found_q1", "overlap_found_q3")


def describe(layouts: Layouts, z_theta: Array, margins: Margins, table_tops: Sequence[str]) -> pd.DataFrame:
    """Return a row per path of z_theta (scene, path, 2) [m], in order: scene, query, z_x, z_y, and what it is like.

    distance: slice of |slack|; nearest: the avoided kind of item with the least slack; items: their number in the
    scene; table_top.
    """
    clearances = clearance(layouts, z_theta)
    alone = [{name: margins[name] if name == symbol else None for name in SYMBOLS} for symbol in SYMBOLS]
    slacks = np.stack([slack(layouts, clearances, one) for one in alone])  # (symbol, scene, path)
    least, nearest = slacks.min(0), np.array(SYMBOLS, dtype=object)[slacks.argmin(0)]
    bins = np.digitize(np.abs(least), DISTANCES[1:-1])
    scene, query = np.indices(least.shape)
    return pd.DataFrame(
        {
            "scene": scene.ravel(),
            "query": query.ravel(),
            "z_x": z_theta[..., 0].ravel(),
            "z_y": z_theta[..., 1].ravel(),
            "distance": np.where(np.isinf(least), NOTHING, np.array(DISTANCE_LABELS)[bins]).ravel(),
            "nearest": np.where(np.isinf(least), NOTHING, nearest).ravel(),
            "items": layouts.present.sum(1)[scene].ravel(),
            "table_top": np.asarray(table_tops)[scene].ravel(),
        }
    )


def slices(judged: pd.DataFrame) -> pd.DataFrame:
    """Return scores by variant, split and slice (`all` first), a row for each value that has paths.

    accuracy, with its quartiles q1 and q3 over seeds; unsafe: share of accepted paths that are invalid; refused: share
    of valid paths rejected; both NaN if there are none, and 0 for `all`; share: of all paths.
    """
    table = judged.assign(
        right=(judged["p"] > 0.5) == judged["valid"],
        unsafe=np.where(judged["p"] > 0.5, ~judged["valid"], np.nan),
        refused=np.where(judged["valid"], judged["p"] <= 0.5, np.nan),
        all="all",
    )
    parts = []
    for name in ("all", *SLICES):
        keys = ["variant", "split", name]
        groups = table.groupby(keys, observed=True)
        part = groups[["right", "unsafe", "refused"]].mean().assign(count=groups.size())
        by_seed = table.groupby([*keys, "seed"], observed=True)["right"].mean().groupby(keys, observed=True)
        part = part.assign(q1=by_seed.quantile(0.25), q3=by_seed.quantile(0.75)).reset_index()
        parts.append(part.rename(columns={name: "value", "right": "accuracy"}).assign(slice=name))
    rows = pd.concat(parts, ignore_index=True)
    rows["value"] = rows["value"].astype(str)
    whole, errors = rows["slice"] == "all", ["unsafe", "refused"]
    rows.loc[whole, errors] = rows.loc[whole, errors].fillna(0.0)  # who accepts nothing accepts nothing invalid
    total = rows[whole].set_index(["variant", "split"])["count"]
    rows["share"] = rows["count"] / total.loc[list(zip(rows["variant"], rows["split"], strict=True))].to_numpy()
    return rows[["variant", "split", "slice", "value", "accuracy", "q1", "q3", "unsafe", "refused", "share", "count"]]


def overlap(judged: pd.DataFrame, users: Sequence[str], split: str) -> pd.DataFrame:
    """Return which paths are valid to both, to one or to neither of two users: the truth first, then each variant.

    Shares of paths; overlap_found: the intersection over union of the paths valid to both with the true ones, with
    its quartiles over seeds (NaN for the truth and an image-blind baseline).
    """
    keys, rows = ["variant", "seed", "scene", "query"], []
    part = judged[judged["split"] == split]
    both = [part[part["user"] == user].set_index(keys)[["p", "valid"]] for user in users]
    joined = both[0].add_suffix("_a").join(both[1].add_suffix("_b"))
    variants = joined.index.unique("variant").tolist()
    for name in ("truth", *variants):
        mine = joined.xs(variants[0] if name == "truth" else name)
        true_a, true_b = mine["valid_a"].astype(bool), mine["valid_b"].astype(bool)
        a, b = (true_a, true_b) if name == "truth" else (mine["p_a"] > 0.5, mine["p_b"] > 0.5)
        hits, union = a & b & true_a & true_b, (a & b) | (true_a & true_b)
        row = {"source": name, "both": (a & b).mean(), "first": (a & ~b).mean(), "second": (~a & b).mean()}
        row |= {"neither": (~a & ~b).mean(), "overlap_found": hits.sum() / max(union.sum(), 1)}
        by_seed = hits.groupby("seed").sum() / union.groupby("seed").sum().clip(lower=1)
        if name not in ("truth", "position_only"):
            row |= {f"overlap_found_{end}": by_seed.quantile(q) for end, q in (("q1", 0.25), ("q3", 0.75))}
        rows.append(row)
    return pd.DataFrame(rows).reindex(columns=[*OVERLAP])
