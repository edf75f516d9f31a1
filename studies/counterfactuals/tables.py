"""The item that each model names, and how far it would have to move."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study


def attributions(study: Study) -> Table:
    """Return how often each model names the true cause of a rejection, beside image-blind rules.

    Intervals are None where there are too few cases for one.
    """
    table = study.table("summary.csv", finite=("right", "baseline_nearest_item"))
    rows = []
    for row in table.to_dict("records"):
        shown = {"User": row["user"], "Model": style.label(row["variant"]), "Right": row["right"]}
        shown |= {name: None if pd.isna(row[f"ci_{name}"]) else row[f"ci_{name}"] for name in ("low", "high")}
        shown |= {"Nearest item": row["baseline_nearest_item"], "Random item": row["baseline_random_item"]}
        rows.append(shown | {"Rejects the empty table": row["empty_rejected"]})
    rows.sort(key=lambda row: study.judged_users.index(row["User"]))
    return Table(pd.DataFrame(rows, dtype=object), dict.fromkeys(list(rows[0])[2:], "pct1"))


def moves(study: Study) -> Table:
    """Return how often a move of the responsible item is found, and its error, in cases that the model rejects.

    Errors and intervals are None where there are too few cases.
    """
    table = study.table("moves.csv", finite=("true_m", "rejected", "found"))
    rows = []
    for row in table.to_dict("records"):
        shown = {"User": row["user"], "Model": style.label(row["variant"]), "Rejected": row["rejected"]}
        shares = {"Move found": "found", "found low": "found_ci_low", "found high": "found_ci_high"}
        lengths = {"Error": "error_m", "error low": "error_m_ci_low", "error high": "error_m_ci_high"}
        lengths |= {"Error of a constant": "constant_error_m"}
        columns = (shares | lengths).items()
        rows.append(shown | {name: None if pd.isna(row[column]) else row[column] for name, column in columns})
    formats = dict.fromkeys(("Rejected", *shares), "pct") | dict.fromkeys(lengths, "cm")
    return Table(pd.DataFrame(rows, dtype=object), formats)
