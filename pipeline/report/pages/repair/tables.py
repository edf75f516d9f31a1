"""Repairs in numbers: every method, variant and user."""

import pandas as pd

from pipeline.report.render import Table
from pipeline.report.results import Results
from pipeline.report.style import label

BASELINES = ("random_path", "constant_detour", "oracle")
COLUMNS = {"Success": "success", "Moved, over the least": "displacement_ratio", "Unsafe": "unsafe"}
FORMATS = {"Success": "pct1", "Moved, over the least": "times", "Unsafe": "pct1"}


def gradient(results: Results) -> Table:
    """Return the paper's repair: 30 gradient steps, by user and model, baselines last."""
    return _table(results, "gradient", ("full", "ae", "classifier", "irl_maxent", "irl_ranked", "clearance"))


def nearest(results: Results) -> Table:
    """Return the nearest path that a model accepts, by user and model."""
    return _table(results, "nearest", ())


def _table(results: Results, method: str, order: tuple[str, ...]) -> Table:
    """Return a row a user and model; baselines accept nothing, so that they have no unsafe share."""
    summary, rows = results.tables["repair"], []
    variants = [v for v in order if v in results.variants] + [v for v in results.variants if v not in order]
    for user in results.repaired_users:
        for variant in variants:
            if ((summary["method"] == method) & (summary["variant"] == variant)).any():
                numbers = {h: results.repair(method, variant, user, c) for h, c in COLUMNS.items()}
                rows.append({"User": user, "Model": label(variant)} | numbers)
        for baseline in BASELINES:
            numbers = {h: results.repair(baseline, "", user, c) for h, c in COLUMNS.items() if c != "unsafe"}
            rows.append({"User": user, "Model": label(baseline)} | numbers | {"Unsafe": None})
    frame = pd.DataFrame(rows, columns=["User", "Model", *COLUMNS])
    return Table(frame.astype(object).where(frame.notna(), None), FORMATS)
