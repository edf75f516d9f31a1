"""Every kind of demonstrations: the paper's model beside image-blind baselines."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

ROUTES = {"any": "any route", "few": "few families of routes"}
COLUMNS = {  # column -> variant and split
    style.label("full"): ("full", "held_out"),
    style.label("nearest_demonstration"): ("nearest_demonstration", "held_out"),
    style.label("position_only"): ("position_only", "held_out"),
    "New tables: " + style.label("full"): ("full", "new_scenes"),
}


def kinds(study: Study) -> Table:
    """Return accuracy on held-out paths of the same kind, the model's lead, and its accuracy in new scenes."""
    table = study.table("summary.csv", finite=("accuracy", "valid"))
    rows = []
    for (routes, clear_cm), of_kind in table.groupby(["routes", "clear_cm"], sort=False):
        by_key = of_kind.set_index(["variant", "split"])
        full = by_key.loc["full", "held_out"]
        shown = {"Routes": ROUTES[str(routes)], "Clear by": f"{clear_cm} cm", "Valid": full["valid"]}
        shown |= {name: by_key["accuracy"].get(key) for name, key in COLUMNS.items()}
        lead = {"Lead over nearest": full["lead"], "q1": full["lead_q1"], "q3": full["lead_q3"]}
        rows.append(shown | lead)
    frame = pd.DataFrame(rows, dtype=object)
    formats = dict.fromkeys(("Valid", *COLUMNS), "pct1") | dict.fromkeys(("Lead over nearest", "q1", "q3"), "points1")
    return Table(frame.where(frame.notna(), None), formats)
