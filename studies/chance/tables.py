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
    table = study.rows("accuracy.csv", source="ceiling")
    rows = []
    for (learner, scenes, clear_cm), part in table.groupby(["learner", "scenes", "clear_cm"], sort=False):
        row = {"Learner": name_of(str(learner)), "Tables": int(scenes) or "–", "Clear by": f"{clear_cm:.0f} cm"}
        for split, name in SPLITS.items():
            judged = part[part["split"] == split]
            for column, shown in {"accuracy": name, "q1": f"{name}, q1", "q3": f"{name}, q3"}.items():
                row[shown] = judged[column].item() if len(judged) else None
        rows.append(row | {"n": int(part["seeds"].iloc[0])})
    shares = [shown for name in SPLITS.values() for shown in (name, f"{name}, q1", f"{name}, q3")]
    return Table(pd.DataFrame(rows, dtype=object), dict.fromkeys(shares, "pct1"))
