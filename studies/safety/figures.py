"""Prepare what the page draws: the effect of an added item by a path's clearance from it."""

import pandas as pd

from pipeline.report.study import Study


def responses(study: Study) -> pd.DataFrame:
    """Return the curves of models and truth; the truth's spread over items is not an error, so it has no interval."""
    table = study.table("response.parquet", finite=("response", "ci_low", "ci_high"))
    truth = table["variant"] == "truth"
    table.loc[truth, ["ci_low", "ci_high"]] = table.loc[truth, ["response", "response"]].to_numpy()
    return table
