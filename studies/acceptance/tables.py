"""Invalid paths among the accepted ones, by rule, split and user."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

RULES = {"conformal": "conformal selection +", "threshold": "P(valid) > 1/2"}


def outcomes(study: Study) -> Table:
    """Return invalid paths among the accepted ones and valid paths accepted, all users together."""
    rows = []
    table = study.table("summary.csv", finite=("invalid", "ci_low", "ci_high", "power"))
    for row in table[table["user"] == "all"].to_dict("records"):
        shown = {"Accepts by": RULES[row["rule"]], "Model": style.label(row["variant"])}
        shown |= {"Scenes": style.label(row["split"]), "Invalid": row["invalid"]}
        shown |= {"low": row["ci_low"], "high": row["ci_high"], "Valid ones accepted": row["power"]}
        rows.append(shown | {"Models above the promise": f"{row['above']} of {row['models']}"})
    return Table(pd.DataFrame(rows), dict.fromkeys(("Invalid", "low", "high", "Valid ones accepted"), "pct1"))
