"""The worst effect of an added item."""

import pandas as pd

from pipeline.report.study import Study


def furthest(study: Study) -> pd.DataFrame:
    """Return for each split and detector the effect furthest from the truth, and how many verdicts are `right`."""
    parts = study.table("verdicts.csv").groupby(["source", "detector"], sort=False)
    worst = [part.loc[[(part["effect"] - part["truth"]).abs().idxmax()]] for _, part in parts]
    right = [f"{part['right'].sum()} of {len(part)}" for _, part in parts]
    return pd.concat(worst).assign(right=right)
