"""Every rule with every model: accuracy, errors that matter, and verdicts on added items."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

RULES = {
    "margin": "keep a distance",
    "dwell": "may come close briefly",
    "side": "only items on the right count",
    "proximity": "only items with a neighbour count",
}
AVERAGED = "clearance_averaged"


def name_of(variant: str) -> str:
    """Return the displayed name of a variant."""
    return "Averaged over rules" if variant == AVERAGED else style.label(variant)


def models(study: Study) -> Table:
    """Return accuracy, the share of invalid paths accepted, training accuracy and right verdicts by rule and model."""
    table = study.table("summary.csv", finite=("accuracy", "ci_low", "ci_high", "unsafe"))
    verdicts = study.table("verdicts.csv").groupby(["family", "variant"])["right"]
    right = (verdicts.sum().astype(int).astype(str) + " of " + verdicts.size().astype(str)).to_dict()
    rows = []
    for row in table.to_dict("records"):
        shown = {"Rule": RULES[row["family"]], "Model": name_of(row["variant"]), "Accuracy": row["accuracy"]}
        shown |= {"low": row["ci_low"], "high": row["ci_high"], "Accepts invalid": row["unsafe"]}
        shown["On its demonstrations"] = None if pd.isna(row["training_accuracy"]) else row["training_accuracy"]
        rows.append(shown | {"Right verdicts": right.get((row["family"], row["variant"]), "–")})
    columns = ("Accuracy", "low", "high", "Accepts invalid", "On its demonstrations")
    return Table(pd.DataFrame(rows, dtype=object), dict.fromkeys(columns, "pct1"))
