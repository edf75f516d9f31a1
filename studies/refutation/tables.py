"""Count the questions that each model passes, by refuter."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

REFUTERS = {
    "dummy_outcome": "labels permuted",
    "placebo_treatment": "placebo",
    "negative_control": "item far from the paths",
    "other_environment": "table top",
    "data_subset": "half of the scenes",
}
CHANGED = "clearance"  # the variant that a note of the study is about


def name_of(refuter: str, setting: str) -> str:
    """Return the displayed name of a refuter with its setting."""
    detail = {"placebo_treatment": f", {setting.partition('=')[2]} px pieces", "other_environment": f" {setting[8:]}"}
    return REFUTERS[refuter] + detail.get(refuter, "")


def passed(study: Study) -> Table:
    """Return the questions passed of those asked; + marks a refuter that the model was changed for."""
    table = study.table("summary.csv", finite=("effect",))
    rows = []
    for (refuter, setting), asked in table.groupby(["refuter", "setting"], sort=False):
        questions = asked.drop_duplicates(["user", "symbol"])  # without an effect, every half says the same
        blind = (questions["expected"] == "negligible") | (refuter == "data_subset")
        row = {"Refuter": name_of(str(refuter), str(setting)), "Image-blind": _count(blind)}
        for variant in study.variants:
            own = asked[asked["variant"] == variant]
            mark = " +" if variant == CHANGED and (own["note"] != "").any() else ""
            row[style.label(variant)] = _count(own["passed"].astype(bool)) + mark if len(own) else "–"
        rows.append(row)
    return Table(pd.DataFrame(rows))


def _count(holds: pd.Series) -> str:
    return f"{holds.sum()} of {len(holds)}"
