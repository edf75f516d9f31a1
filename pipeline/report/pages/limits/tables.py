"""Numbers of failures: maps on a patterned table top, and the scenes with most errors."""

import numpy as np

from pipeline.report.page import Table, pick, with_gaps
from pipeline.report.pages.limits.figures import failing, worst_scenes
from pipeline.report.results import Results
from pipeline.report.style import label

DRAWN = "maps by the first seed’s models"  # not from a table


def patterned(results: Results) -> Table:
    """Return shares over the maps of the mapped scenes, as they are and on the patterned top, by model and user."""
    drawn, rows = results.drawn, []
    results.reads.append(DRAWN)
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
    frame = with_gaps(rows)
    return Table(frame, dict.fromkeys(frame.columns[2:], "pct"))


def worst(results: Results) -> Table:
    """Return the scenes with most errors of the model whose failures are shown."""
    names = {
        "scene": "Scene", "user": "User", "table_top": "Table top", "items": "Items", "accuracy": "Right",
        "unsafe": "Invalid and accepted", "errors": "Of all errors",
    }  # fmt: skip
    frame = pick(worst_scenes(results), names, scene=str)
    return Table(frame, {"Items": "count", **dict.fromkeys(("Right", "Invalid and accepted", "Of all errors"), "pct")})


def unsafe(results: Results) -> Table:
    """Return how often accepted paths are invalid and valid ones refused, in new scenes with unseen items.

    With quartiles over training sets of the first kind; the last row accepts every path.
    """
    judged, unsafe, refused = results.tables["judged"], "Accepted, but invalid", "Valid, but refused"
    judged, rows = judged[judged["split"] == "new_items"], []
    for variant in dict.fromkeys([failing(results), *results.shown]):
        accepted = judged[(judged["variant"] == variant) & (judged["p"] > 0.5)]
        q1, q3 = (1 - accepted.groupby("seed")["valid"].mean()).quantile([0.25, 0.75])
        rates = {unsafe: results.sliced(variant, "unsafe"), f"{unsafe}, q1": q1, f"{unsafe}, q3": q3}
        rows.append({"Model": label(variant)} | rates | {refused: results.sliced(variant, "refused")})
    paths = judged[judged["variant"] == failing(results)]
    rows.append({"Model": label("blind"), unsafe: 1 - paths["valid"].mean(), refused: 0.0})
    frame = with_gaps(rows)
    return Table(frame, dict.fromkeys(frame.columns[1:], "pct1"))
