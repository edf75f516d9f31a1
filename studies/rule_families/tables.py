"""Every rule with every model: accuracy, errors that matter, and verdicts on added items."""

from pipeline.report import style
from pipeline.report.page import Table, pick, with_gaps
from pipeline.report.study import Study

RULES = {
    "margin": "keep a distance",
    "dwell": "may come close briefly",
    "side": "only items on the right count",
    "proximity": "only items with a neighbour count",
}


def models(study: Study) -> Table:
    """Return accuracy, the share of invalid paths accepted, training accuracy and right verdicts by rule and model."""
    table = study.table("summary.csv", finite=("accuracy", "ci_low", "ci_high", "unsafe"))
    verdicts = study.table("verdicts.csv").groupby(["family", "variant"])["right"]
    right = (verdicts.sum().astype(int).astype(str) + " of " + verdicts.size().astype(str)).to_dict()
    keys = table[["family", "variant"]].itertuples(index=False, name=None)
    table = table.assign(right=[right.get(key, "–") for key in keys])
    titles = {
        "family": "Rule", "variant": "Model", "accuracy": "Accuracy", "ci_low": "low", "ci_high": "high",
        "unsafe": "Invalid paths accepted", "training_accuracy": "On its demonstrations", "right": "Right verdicts",
    }  # fmt: skip
    frame = with_gaps(pick(table, titles, family=RULES, variant=style.label))
    columns = ("Accuracy", "low", "high", "Invalid paths accepted", "On its demonstrations")
    return Table(frame, dict.fromkeys(columns, "pct1"))
