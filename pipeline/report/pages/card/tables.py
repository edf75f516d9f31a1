"""Scores of the clearance model by slices of the test paths."""

import pandas as pd

from pipeline.report.page import Table, pick, with_gaps
from pipeline.report.pages.limits.figures import failing
from pipeline.report.results import Results
from pipeline.report.slices import DISTANCE_LABELS, NOTHING, SLICES

TITLES = {
    "slice": "Slice", "value": "Value", "accuracy": "Right", "q1": "Right, q1", "q3": "Right, q3",
    "blind": "Right by position alone", "unsafe": "Accepted, but invalid", "refused": "Valid, but refused",
    "paths": "Paths",
}  # fmt: skip


def slice_rows(results: Results) -> pd.DataFrame:
    """Return the slices of unseen-item paths in the order of SLICES, distances from near to far."""
    table = results.tables["slices"]
    table = table[(table["split"] == "new_items") & table["slice"].isin(SLICES)]
    blind = table[table["variant"] == "position_only"].set_index(["slice", "value"])["accuracy"]
    table = table[table["variant"] == failing(results)].join(blind.rename("blind"), on=["slice", "value"])
    order = {name: i for i, name in enumerate([*DISTANCE_LABELS, NOTHING])}
    by = table.assign(a=table["slice"].map(list(SLICES).index), b=table["value"].map(lambda v: order.get(v, 0)))
    return by.sort_values(["a", "b", "value"]).drop(columns=["a", "b"])


def slices(results: Results) -> Table:
    """Return accuracy of each slice beside the image-blind baseline's, both kinds of error, and its number of paths."""
    rows = slice_rows(results)
    rows = rows.assign(paths=rows["count"] / len(results.seeds))
    frame = with_gaps(pick(rows, TITLES, slice=SLICES))
    return Table(frame, dict.fromkeys(frame.columns[2:], "pct1") | {"Paths": "count"})
