"""Accuracy, tests of differences, and probability scores."""

import pandas as pd

from pipeline.report.page import Table
from pipeline.report.results import Results
from pipeline.report.style import label

SPLITS = ("seen_scenes", "new_scenes", "new_items")
BASELINES = {"nearest_demonstration": SPLITS[:1], "position_only": SPLITS}  # baselines and the splits they exist for


def accuracy(results: Results) -> Table:
    """Return accuracy at main_n_demos, one row per variant and one column per split, with quartiles for the last."""
    rows = []
    for variant in [*results.variants, *BASELINES]:
        has = BASELINES.get(variant, SPLITS)
        row = {label(s).capitalize(): results.accuracy(variant, s) if s in has else None for s in SPLITS}
        learned = variant in results.variants
        quartiles = {
            f"unseen items, {q}": results.accuracy(variant, "new_items", q) if learned else None for q in ("q1", "q3")
        }
        rows.append({"Model": label(variant)} | row | quartiles)
    frame = pd.DataFrame(rows).astype(object).where(lambda t: t.notna(), None)
    return Table(frame, dict.fromkeys(frame.columns[1:], "pct1"))


def comparisons(results: Results) -> Table:
    """Return all tests fixed in advance: difference in percentage points, Holm p, and significance."""
    rows = results.tables["comparisons"]
    frame = pd.DataFrame(
        {
            "Model": rows["variant"].map(label),
            "Against": rows["against"].map(label),
            "Paths in": rows["split"].map(label),
            "Demonstrations": rows["n_demos"],
            "Points": rows["difference"],
            "Holm p": rows["p_holm"],
            "Different": rows["significant"].astype(bool).map({True: "yes", False: "no"}),
        }
    )
    return Table(frame, {"Demonstrations": "count", "Points": "points1", "Holm p": "fine"})


def scores(results: Results) -> Table:
    """Return scores of the predicted probabilities in new scenes with unseen items."""
    columns = {"Calibration error": "ece", "Brier score": "brier", "Bias": "bias", "AUROC": "auroc"}
    rows = [
        {"Model": label(v)} | {h: results.value("scores", c, variant=v, split="new_items") for h, c in columns.items()}
        for v in results.variants
    ]
    return Table(pd.DataFrame(rows), dict.fromkeys(columns, "fine"))
