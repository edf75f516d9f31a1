"""Scores of the clearance model by slices of the test paths."""

import pandas as pd

from pipeline.report.page import Table
from pipeline.report.pages.limits.figures import failing
from pipeline.report.results import Results
from pipeline.report.slices import DISTANCE_LABELS, NOTHING, SLICES


def slice_rows(results: Results) -> pd.DataFrame:
    """Return the slices of unseen-item paths in the order of SLICES, distances from near to far."""
    table = results.tables["slices"]
    table = table[
        (table["variant"] == failing(results)) & (table["split"] == "new_items") & table["slice"].isin(SLICES)
    ]
    order = {name: i for i, name in enumerate([*DISTANCE_LABELS, NOTHING])}
    by = table.assign(a=table["slice"].map(list(SLICES).index), b=table["value"].map(lambda v: order.get(v, 0)))
    return by.sort_values(["a", "b", "value"]).drop(columns=["a", "b"])


def slices(results: Results) -> Table:
    """Return accuracy, unsafe and refused shares of each slice, and its share of all paths."""
    rows = slice_rows(results)
    frame = pd.DataFrame(
        {
            "Slice": rows["slice"].map(SLICES).to_numpy(),
            "Value": rows["value"].to_numpy(),
            "Right": rows["accuracy"].to_numpy(),
            "Accepted, but invalid": rows["unsafe"].to_numpy(),
            "Valid, but refused": rows["refused"].to_numpy(),
            "Share of paths": rows["share"].to_numpy(),
        }
    ).astype(object)
    return Table(frame.where(frame.notna(), None), dict.fromkeys(frame.columns[2:], "pct1"))
