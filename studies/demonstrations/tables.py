"""Every kind of demonstrations: the paper's model beside image-blind baselines."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

COLUMNS = {  # column -> variant and split
    style.label("full"): ("full", "held_out"),
    "Nearest": ("nearest_demonstration", "held_out"),
    "Position only": ("position_only", "held_out"),
    "New tables": ("full", "new_scenes"),
}


def kinds(study: Study) -> Table:
    """Return accuracy on held-out paths of the same kind, the model's lead, and its accuracy in new scenes."""
    table = study.table("summary.csv", finite=("accuracy", "valid"))
    rows = []
    for (routes, clear_cm), of_kind in table.groupby(["routes", "clear_cm"], sort=False):
        by_key = of_kind.set_index(["variant", "split"])
        full = by_key.loc["full", "held_out"]
        shown = {"Routes": routes, "Clear by": f"{clear_cm} cm", "Valid": full["valid"]}
        for name, key in COLUMNS.items():
            shown |= {name: by_key["accuracy"].get(key)}
            shown |= {f"{name}, {end}": by_key[end].get(key) for end in ("q1", "q3")}
        lead = {"Lead": full["lead"], "Lead, q1": full["lead_q1"], "Lead, q3": full["lead_q3"]}
        rows.append(shown | lead)
    frame = pd.DataFrame(rows, dtype=object)
    accuracies = [f"{name}{end}" for name in COLUMNS for end in ("", ", q1", ", q3")]
    formats = dict.fromkeys(["Valid", *accuracies], "pct") | dict.fromkeys(("Lead", "Lead, q1", "Lead, q3"), "points1")
    return Table(frame.where(frame.notna(), None), formats)
