"""What the page on earlier tests draws: accuracy over all draws of test scenes."""

import pandas as pd

from pipeline.report.results import Results
from pipeline.report.style import label

VARIANTS = {v: label(v) for v in ("clearance", "irl_ranked", "irl_maxent", "full")}
DRAWS = {"root_seed": "Root seed"} | VARIANTS | {"changed_after_opening": "Changed afterwards"}


def draws(results: Results) -> pd.DataFrame:
    """Return accuracy with unseen items by draw of test scenes, this run's last."""
    rows = results.table("draws").melt("root_seed", list(VARIANTS), "variant", "accuracy").dropna(subset="accuracy")
    shown = [variant for variant in VARIANTS if variant in results.variants]
    now = {"variant": shown, "accuracy": [results.accuracy(v, "new_items") for v in shown]}
    this = results.facts["root_seed"]
    return pd.concat([rows[rows["root_seed"] != this], pd.DataFrame(now).assign(root_seed=this)], ignore_index=True)


def changes(results: Results) -> pd.DataFrame:
    """Return every change made because of a test, in the order of the draws."""
    return results.table("changes").sort_values("after_draw", kind="stable")
