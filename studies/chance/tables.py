"""The conditions of the map, by learner: accuracy, spread and whether it reaches the paper's rate."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

SPLITS = {"seen_scenes": "Training tables", "new_scenes": "New tables"}


def name_of(learner: str) -> str:
    """Return the displayed name of a learner or baseline."""
    return "Perfect encoder" if learner == "perfect" else style.label(learner)


def conditions(study: Study) -> Table:
    """Return every condition of the map; image-blind baselines have no number of training scenes."""
    rows = []
    for row in study.rows("accuracy.csv", source="ceiling").to_dict("records"):
        shown = {"Learner": name_of(row["learner"]), "Training tables": int(row["scenes"]) or "–"}
        shown |= {"Clear by": f"{row['clear_cm']:.0f} cm", "Judged on": SPLITS[row["split"]]}
        shown |= {"Accuracy": row["accuracy"], "q1": row["q1"], "q3": row["q3"], "Training sets": int(row["seeds"])}
        rows.append(shown | {"Reaches": "yes" if row["reaches"] else "no"})
    return Table(pd.DataFrame(rows, dtype=object), dict.fromkeys(("Accuracy", "q1", "q3"), "pct1"))
