"""The best setting of each learner beside its default, on validation scenes and on test scenes."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

SPLITS = {"seen_scenes": "Training tables", "new_items": "New tables, unseen items"}


def learners(study: Study) -> Table:
    """Return a row for each learner and setting: validation result, and test accuracy with quartiles."""
    summary, rows = study.table("summary.csv"), []
    for row in study.table("learners.csv").to_dict("records"):
        for setting in ("default", "best"):
            shown = {"Learner": style.label(row["learner"]), "Setting": setting, "Validation": row[setting]}
            of_setting = summary[(summary["learner"] == row["learner"]) & (summary["setting"] == setting)]
            for split, name in SPLITS.items():
                judged = of_setting[of_setting["split"] == split].iloc[0]
                shown |= {name: judged["accuracy"], f"{name}, q1": judged["q1"], f"{name}, q3": judged["q3"]}
            rows.append(shown | {"n": int(of_setting["seeds"].iloc[0])})
    shares = ["Validation", *(f"{name}{end}" for name in SPLITS.values() for end in ("", ", q1", ", q3"))]
    return Table(pd.DataFrame(rows, dtype=object), dict.fromkeys(shares, "pct1"))
