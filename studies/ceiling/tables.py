"""Every learner and number of training scenes: own demonstrations, training scenes and new scenes."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

SPLITS = {"seen_scenes": "Training tables", "new_scenes": "New tables"}


def name_of(learner: str) -> str:
    """Return the displayed name of a learner or baseline."""
    return "Perfect encoder" if learner == "perfect" else style.label(learner)


def learners(study: Study) -> Table:
    """Return accuracy at random paths by learner and number of training scenes, with quartiles over training sets."""
    rows = []
    table = study.table("summary.csv").query("clear_cm == 0")
    for (learner, scenes), of_learner in table.groupby(["learner", "scenes"], sort=False):
        by_split = of_learner.set_index("split")
        shown = {"Model": name_of(str(learner)), "Tables": scenes or "–"}
        shown["Steps"] = of_learner["steps"].iloc[0] or "–"
        shown["Own demonstrations"] = by_split["accuracy"].get("demonstrations")
        for split, name in SPLITS.items():
            shown[name] = by_split["accuracy"].get(split)
            shown |= {f"{name}, {end}": by_split[end].get(split) for end in ("q1", "q3")}
        rows.append(shown | {"n": by_split["seeds"].iloc[0]})
    columns = ["Own demonstrations", *(f"{name}{end}" for name in SPLITS.values() for end in ("", ", q1", ", q3"))]
    frame = pd.DataFrame(rows, dtype=object)
    return Table(frame.where(frame.notna(), None), dict.fromkeys(columns, "pct1"))
