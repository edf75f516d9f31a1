"""The worst strength of each disturbance."""

import pandas as pd

from pipeline.report.page import Table
from pipeline.report.study import Study

LABELS = {
    "shade": "uneven light",
    "tint": "warm light",
    "blur": "blur",
    "noise": "sensor noise",
    "arm": "an arm in view",
    "texture": "table top",
    "clutter": "added items",
    "mislabelled": "wrong labels",
}
MODELS = {"position_only": "Position only", "full": "Paper’s model", "clearance": "Clearance"}  # columns of the table
SHOWN = ("full", "irl_maxent", "irl_ranked", "clearance")  # variants in figures


def strongest(study: Study) -> Table:
    """Return accuracy and the share of invalid paths accepted at full strength and on each table top."""
    table = study.table("summary.csv", finite=("accuracy", "loss", "unsafe"))
    rows = []
    for (kind, strength), group in table.groupby(["corruption", "strength"], sort=False):
        last = list(table.loc[table["corruption"] == kind, "strength"])[-1]
        if kind != "texture" and strength != last:
            continue
        of = group.set_index("variant")
        name = "none" if kind == "none" else f"{LABELS[str(kind)]}, {strength}"
        row: dict[str, object] = {"Disturbance": name}
        row |= {title: of["accuracy"].get(variant) for variant, title in MODELS.items()}
        row |= {"low": of["ci_low"].get("clearance"), "high": of["ci_high"].get("clearance")}
        rows.append(row | {"Invalid paths accepted": of["unsafe"].get("clearance")})
    columns = (*MODELS.values(), "low", "high", "Invalid paths accepted")
    return Table(pd.DataFrame(rows, dtype=object), dict.fromkeys(columns, "pct1"))
