"""Tables of the page of one's own table; the template names these functions."""

import numpy as np
import pandas as pd

from pipeline.own import detection
from pipeline.own.fitting import VARIANT
from pipeline.own.paths import DEGREES
from pipeline.own.results import Results
from pipeline.report import style
from pipeline.report.page import Table, pick, with_gaps

FIRST_REPAIRS, FIRST_SCENES = 12, 5  # rows shown for each user; the csv files hold all


def degrees(results: Results) -> Table:
    """Return the residual on held-out stretches of the demonstrations by degree of the path."""
    demos = results.demos
    rows = [
        {
            "Control points": degree - 1,
            "Median residual": float(demos[f"held_out_{degree}"].median()),
            "90th percentile": float(demos[f"held_out_{degree}"].quantile(0.9)),
            "Picked for": float((demos["degree"] == degree).mean()),
        }
        for degree in DEGREES
    ]
    return Table(pd.DataFrame(rows), {"Median residual": "cm", "90th percentile": "cm", "Picked for": "pct"})


def recall(results: Results) -> Table:
    """Return the share of listed items that were detected, by kind."""
    assert results.detected is not None
    shown = pick(detection.recall(results.detected), {"kind": "Kind", "items": "Items", "recall": "Detected"})
    return Table(shown, {"Items": "count", "Detected": "pct"})


def accuracy(results: Results) -> Table:
    """Return the scores of each predictor on scenes that it was not fitted to."""
    whole = results.scores[results.scores["share"] == 1]
    titles = {
        "user": "User",
        "predictor": "Predictor",
        "accuracy": "Accuracy",
        "ci_low": "From",
        "ci_high": "To",
        "balanced": "Balanced accuracy",
        "missed": "Invalid paths accepted",
        "calibration_error": "Calibration error",
    }
    shown = pick(whole, titles, predictor=style.label)
    return Table(with_gaps(shown), dict.fromkeys(list(titles.values())[2:], "pct"))


def effects(results: Results) -> Table:
    """Return what adding each kind does to each user's accepted share of paths, and the verdict."""
    assert results.effects is not None
    titles = {
        "user": "User",
        "kind": "Kind",
        "verdict": "Verdict",
        "effect": "Change of P(valid)",
        "ci_low": "From",
        "ci_high": "To",
        "lowest": "Least of the fold models",
        "highest": "Most of the fold models",
    }
    return Table(pick(results.effects, titles), dict.fromkeys(list(titles.values())[3:], "effect"))


def envelopes(results: Results) -> Table:
    """Return the distance that each user keeps from each kind."""
    assert results.envelopes is not None
    titles = {"user": "User", "kind": "Kind", "radius_m": "Distance kept", "ci_low": "From", "ci_high": "To"}
    return Table(pick(results.envelopes, titles), dict.fromkeys(list(titles.values())[2:], "cm"))


def repairs(results: Results) -> Table:
    """Return the first repairs of each user's invalid demonstrations."""
    shown = results.repairs.groupby("user", sort=False).head(FIRST_REPAIRS)
    titles = {
        "user": "User",
        "scene": "Scene",
        "demo": "Demonstration",
        "p_before": "P(valid) before",
        "p_after": "P(valid) after",
        "moved_m": "Path’s middle moves",
    }
    return Table(
        with_gaps(pick(shown, titles)),
        {"P(valid) before": "rate", "P(valid) after": "rate", "Path’s middle moves": "cm"},
    )


def scenes_to_show(results: Results) -> Table:
    """Return the scenes about which each user's models disagree most."""
    shown = results.advice.groupby("user", sort=False).head(FIRST_SCENES)
    titles = {"user": "User", "scene": "Scene", "shown": "Has demonstrations", "disagreement": "Disagreement"}
    return Table(pick(shown, titles, shown=lambda yes: "yes" if yes else "no"), {"Disagreement": "fine"})


def learning(results: Results) -> Table:
    """Return accuracy by number of training scenes."""
    rows = results.scores[results.scores["predictor"] == VARIANT].sort_values(["user", "share"], kind="stable")
    shown = pick(
        rows,
        {
            "user": "User",
            "share": "Share of training scenes",
            "accuracy": "Accuracy",
            "ci_low": "From",
            "ci_high": "To",
        },
    )
    return Table(shown, dict.fromkeys(("Share of training scenes", "Accuracy", "From", "To"), "pct"))


def without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table for csv whose texts no spreadsheet takes for a formula: ' stands before = + - @ tab and return."""

    def safe(value: object) -> object:
        return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value

    texts = [c for c in table.columns if not pd.api.types.is_numeric_dtype(table[c]) or table[c].dtype == object]
    return table.assign(**{str(column): table[column].map(safe) for column in texts}).replace({np.nan: None})
