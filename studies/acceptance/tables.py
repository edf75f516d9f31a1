"""Invalid paths among the accepted ones, by rule, split and user."""

from pipeline.report import style
from pipeline.report.study import Study
from pipeline.report.tables import Table, pick

RULES = {"conformal": "conformal selection +", "threshold": "P(valid) > 1/2"}


def outcomes(study: Study) -> Table:
    """Return invalid paths among the accepted ones and valid paths accepted, all users together."""
    table = study.table("summary.csv", finite=("invalid", "ci_low", "ci_high", "power"))
    table = table[table["user"] == "all"]
    table = table.assign(above=table["above"].astype(str) + " of " + table["models"].astype(str))
    titles = {
        "rule": "Accepts by", "variant": "Model", "split": "Scenes", "invalid": "Invalid", "ci_low": "low",
        "ci_high": "high", "power": "Valid ones accepted", "above": "Models above the promise",
    }  # fmt: skip
    frame = pick(table, titles, rule=RULES, variant=style.label, split=style.label)
    return Table(frame, dict.fromkeys(("Invalid", "low", "high", "Valid ones accepted"), "pct1"))
