"""Numbers of failures: maps on a patterned table top, and the scenes with most errors."""

import numpy as np
import pandas as pd

from pipeline.report.page import Table
from pipeline.report.pages.limits.figures import failing, worst_scenes
from pipeline.report.results import Results
from pipeline.report.style import label


def patterned(results: Results) -> Table:
    """Return shares over the maps of the mapped scenes, as they are and on the patterned top, by model and user."""
    drawn, rows = results.drawn, []
    for variant in results.shown:
        for user, truth in drawn.truth.items():
            row: dict[str, str | float | None] = {"Model": label(variant), "User": user}
            for name, maps in (
                ("Own top", drawn.maps),
                (results.facts["patterned_top"].capitalize(), drawn.patterned_maps),
            ):
                accepted = maps[variant][user] > 0.5
                row |= {f"{name}: valid refused": float(np.mean(~accepted[truth])) if truth.any() else None}
                row |= {f"{name}: invalid accepted": float(np.mean(accepted[~truth])) if not truth.all() else None}
            rows.append(row)
    frame = pd.DataFrame(rows).astype(object)
    return Table(frame.where(frame.notna(), None), dict.fromkeys(frame.columns[2:], "pct"))


def worst(results: Results) -> Table:
    """Return the scenes with most errors of the model whose failures are shown."""
    names = {
        "scene": "Scene", "user": "User", "table_top": "Table top", "items": "Items", "accuracy": "Right",
        "unsafe": "Invalid and accepted", "errors": "Of all errors",
    }  # fmt: skip
    frame = worst_scenes(results)[list(names)].rename(columns=names).reset_index(drop=True)
    frame["Scene"] = frame["Scene"].map(str)
    return Table(frame, {"Items": "count", **dict.fromkeys(("Right", "Invalid and accepted", "Of all errors"), "pct")})


def unsafe(results: Results) -> Table:
    """Return how often accepted paths are invalid and valid ones refused, for new scenes with unseen items."""
    shown = [v for v in results.shown if v in results.variants]
    rows = [
        {"Model": label(v)} | {
            name: results.sliced(v, column, **where)
            for name, column, where in (
                ("Accepted, but invalid", "unsafe", {}),
                ("Valid, but refused", "refused", {}),
            )
        }
        for v in dict.fromkeys([failing(results), *shown])
    ]  # fmt: skip
    return Table(pd.DataFrame(rows), dict.fromkeys(("Accepted, but invalid", "Valid, but refused"), "pct1"))
