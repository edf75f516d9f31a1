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
    """Return all tests fixed in advance, a row per pair: differences in accuracy by split, and where Holm's p < .05."""
    rows, formats = [], {"Demonstrations": "count"} | {label(s).capitalize(): "points1" for s in SPLITS}
    tests = results.tables["comparisons"]
    for (variant, against, n), part in tests.groupby(["variant", "against", "n_demos"], sort=False):
        part = part.set_index("split")
        won = [s for s in SPLITS if s in part.index and part.loc[s, "significant"]]
        row = {"Model": label(str(variant)), "Against": label(str(against)), "Demonstrations": n}
        row |= {label(s).capitalize(): part["difference"].get(s) for s in SPLITS}
        where = "everywhere" if len(won) == len(part) else ", ".join(map(label, won)) or "nowhere"
        rows.append(row | {"Significant": where})
    frame = pd.DataFrame(rows).astype(object)
    return Table(frame.where(frame.notna(), None), formats)


def scores(results: Results) -> Table:
    """Return scores of the predicted probabilities in new scenes with unseen items."""
    columns = {"Calibration error": "ece", "Brier score": "brier", "Bias": "bias", "AUROC": "auroc"}
    rows = [
        {"Model": label(v)} | {h: results.value("scores", c, variant=v, split="new_items") for h, c in columns.items()}
        for v in results.variants
    ]
    return Table(pd.DataFrame(rows), dict.fromkeys(columns, "fine"))
