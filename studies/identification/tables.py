"""Who is named after all paths, and whether a stranger is noticed."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study


def after_all_paths(study: Study) -> Table:
    """Return accuracy over all scenes and over those where users differ, and the share of users rejected."""
    table, unknown = study.table("summary.csv", finite=("accuracy",)), study.table("open_set.csv", finite=("rejected",))
    k = int(table["k"].max())
    rejected = unknown[unknown["k"] == k].pivot(index="variant", columns="user", values="rejected")
    rows = []
    for row in table[table["k"] == k].to_dict("records"):
        shown = {"Model": style.label(row["variant"]), "All scenes": row["accuracy"], "low": row["ci_low"]}
        shown |= {"high": row["ci_high"], "Users differ": row["distinct_accuracy"]}
        shown |= {"Stranger noticed": rejected.loc[row["variant"], "stranger"]}
        rows.append(shown | {"Known user rejected": rejected.loc[row["variant"], "all"]})
    return Table(pd.DataFrame(rows), dict.fromkeys(list(rows[0])[1:], "pct1"))
