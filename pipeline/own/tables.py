"""Tables of the page of one's own table; the template names these functions."""

import pandas as pd

from pipeline.own.fitting import VARIANT
from pipeline.own.paths import DEGREES
from pipeline.own.results import Results
from pipeline.report import style
from pipeline.report.page import Table, pick, with_gaps

FIRST_REPAIRS, FIRST_SCENES = 12, 5  # rows shown for each user; the csv files hold all
TITLES = {  # of columns whose names do not say enough
    "demo": "Demonstration",
    "shown": "Has demonstrations",
    "recall": "Detected",
    "share": "Share of training scenes",
    "effect": "Change of P(valid)",
    "radius_m": "Distance kept",
    "ci_low": "From",
    "ci_high": "To",
    "balanced": "Balanced accuracy",
    "missed": "Invalid paths accepted",
    "lowest": "Least without a group",
    "highest": "Most without a group",
    "p_before": "P(valid) before",
    "p_after": "P(valid) after",
    "moved_m": "Path’s middle moves",
}


def _shown(rows: pd.DataFrame, texts: list[str], numbers: dict[str, str]) -> Table:
    """Return columns of `rows` under their titles: texts, and numbers with their formats."""
    titles = {column: TITLES.get(column, column.replace("_", " ").capitalize()) for column in [*texts, *numbers]}
    return Table(with_gaps(pick(rows, titles)), {titles[column]: form for column, form in numbers.items()})


def degrees(results: Results) -> Table:
    """Return the residual on held-out stretches of the demonstrations by degree of the path."""
    demos = results.tables["demonstrations"]
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
    """Return the number of listed items and the share that was detected, by kind and over all."""
    detected = results.tables["detections"]
    rows = detected.groupby("kind")["detected"].agg(items="size", recall="mean").reset_index()
    rows.loc[len(rows)] = ["all", len(detected), detected["detected"].mean()]
    return _shown(rows, ["kind"], {"items": "count", "recall": "pct"})


def accuracy(results: Results) -> Table:
    """Return the scores of each predictor on scenes that it was not fitted to."""
    rows = results.tables["scores"].query("share == 1")
    rates = ("accuracy", "ci_low", "ci_high", "balanced", "missed", "calibration_error")
    rows = rows.assign(predictor=rows["predictor"].map(style.label))
    return _shown(rows, ["user", "predictor"], dict.fromkeys(rates, "pct"))


def effects(results: Results) -> Table:
    """Return what adding each kind does to each user's accepted share of paths, and the verdict."""
    changes = ("effect", "ci_low", "ci_high", "lowest", "highest")
    return _shown(results.tables["interventions"], ["user", "kind", "verdict"], dict.fromkeys(changes, "effect"))


def envelopes(results: Results) -> Table:
    """Return the distance that each user keeps from each kind."""
    lengths = ("radius_m", "ci_low", "ci_high")
    return _shown(results.tables["distances"], ["user", "kind"], dict.fromkeys(lengths, "cm"))


def repairs(results: Results) -> Table:
    """Return the first repairs of each user's invalid demonstrations."""
    rows = results.tables["repaired"].groupby("user", sort=False).head(FIRST_REPAIRS)
    return _shown(rows, ["user", "scene", "demo"], {"p_before": "rate", "p_after": "rate", "moved_m": "cm"})


def scenes_to_show(results: Results) -> Table:
    """Return the scenes about which each user's models disagree most."""
    rows = results.tables["disagreement"].groupby("user", sort=False).head(FIRST_SCENES)
    rows = rows.assign(shown=rows["shown"].map({True: "yes", False: "no"}))
    return _shown(rows, ["user", "scene", "shown"], {"disagreement": "fine"})


def learning(results: Results) -> Table:
    """Return accuracy by share of the training scenes."""
    scores = results.tables["scores"]
    return _shown(
        scores[scores["predictor"] == VARIANT],
        ["user"],
        dict.fromkeys(("share", "accuracy", "ci_low", "ci_high"), "pct"),
    )
