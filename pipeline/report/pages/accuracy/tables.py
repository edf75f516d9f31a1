"""Accuracy, tests of differences, and probability scores."""

from pipeline.report.page import Table, with_gaps
from pipeline.report.results import Results
from pipeline.report.style import label

SPLITS = ("seen_scenes", "new_scenes", "new_items")
BLIND = {"nearest_demonstration": SPLITS[:1], "position_only": SPLITS}  # baselines and the splits they exist for


def accuracy(results: Results) -> Table:
    """Return accuracy at main_n_demos, one row per variant and one column per split."""
    rows = []
    for variant in [*results.variants, *BLIND]:
        row: dict[str, str | float | None] = {"Model": label(variant)}
        for split in SPLITS:
            title = label(split).capitalize()
            row[title] = results.accuracy(variant, split) if split in BLIND.get(variant, SPLITS) else None
            for end in ("q1", "q3"):
                row[f"{title}, {end}"] = results.accuracy(variant, split, end) if variant not in BLIND else None
        rows.append(row)
    frame = with_gaps(rows)
    return Table(frame, dict.fromkeys(frame.columns[1:], "pct1"))


def comparisons(results: Results) -> Table:
    """Return all tests fixed in advance, a row per pair: differences in accuracy by split, and where Holm's p < .05."""
    rows = []
    tests = results.tables["comparisons"]
    for (variant, against, n), part in tests.groupby(["variant", "against", "n_demos"], sort=False):
        part = part.set_index("split")
        won = [s for s in SPLITS if s in part.index and part.loc[s, "significant"]]
        row = {"Model": label(str(variant)), "Against": label(str(against)), "Demonstrations": n}
        for split in SPLITS:
            for end, column in (("", "difference"), (", q1", "q1"), (", q3", "q3")):
                row[label(split).capitalize() + end] = part[column].get(split)
        where = "everywhere" if len(won) == len(part) else ", ".join(map(label, won)) or "nowhere"
        rows.append(row | {"Significant": where})
    frame = with_gaps(rows)
    return Table(frame, {"Demonstrations": "count"} | dict.fromkeys(frame.columns[3:-1], "points1"))


def scores(results: Results) -> Table:
    """Return scores of the predicted probabilities in new scenes with unseen items."""
    columns = {"Calibration error": "ece", "Brier score": "brier", "Bias": "bias", "AUROC": "auroc"}
    rows = []
    for variant in [*results.variants, "position_only"]:
        row: dict[str, str | float | None] = {"Model": label(variant)}
        for title, column in columns.items():
            row[title] = results.value("scores", column, variant=variant, split="new_items")
            for end in ("q1", "q3"):
                name = f"{column}_{end}"
                spread = None if variant in BLIND else results.value("scores", name, variant=variant, split="new_items")
                row[f"{title}, {end}"] = spread
        rows.append(row)
    frame = with_gaps(rows)
    return Table(frame, dict.fromkeys(frame.columns[1:], "fine"))
