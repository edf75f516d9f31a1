"""What the page on the paper's claims draws."""

import pandas as pd

from pipeline.report.claims import PAPER, claims_table
from pipeline.report.results import Results
from pipeline.report.style import label


def rates(results: Results) -> pd.DataFrame:
    """Return accuracy in the training scenes and success of gradient repair: paper, ours, image-blind."""
    claims = claims_table(results).dropna(subset=["paper", "q1"])
    rates = [f"accuracy, {label(m)}" if m == "seen_scenes" else f"repair, {m}" for m in claims["measure"]]
    columns = {
        "paper": ["paper", "paper_low", "paper_high"],
        PAPER: ["ours", "q1", "q3"],
        "blind": ["baseline", "baseline", "baseline"],
    }
    parts = [
        pd.DataFrame(claims[names].to_numpy(float), columns=["value", "low", "high"]).assign(rate=rates, source=source)
        for source, names in columns.items()
    ]
    return pd.concat(parts, ignore_index=True)
