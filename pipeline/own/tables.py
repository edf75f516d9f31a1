"""Tables of the page of one's own table; the template names these functions."""

import pandas as pd

from pipeline.own.fitting import VARIANT
from pipeline.own.report import Results
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


def _shown(rows: pd.DataFrame, texts: str, **numbers: str) -> Table:
    """Return columns of `rows` under their titles: texts, then the columns of numbers of each format."""
    formats = {column: form for form, columns in numbers.items() for column in columns.split()}
    titles = {
        column: TITLES.get(column, column.replace("_", " ").capitalize()) for column in [*texts.split(), *formats]
    }
    return Table(with_gaps(pick(rows, titles)), {titles[column]: form for column, form in formats.items()})


def recall(results: Results) -> Table:
    """Return the number of listed items and the share that was detected, by kind and over all."""
    detected = results.tables["detections"]
    rows = detected.groupby("kind")["detected"].agg(items="size", recall="mean").reset_index()
    rows.loc[len(rows)] = ["all", len(detected), detected["detected"].mean()]
    return _shown(rows, "kind", count="items", pct="recall")


def accuracy(results: Results) -> Table:
    """Return the scores of each predictor on scenes that it was not fitted to."""
    rows = results.tables["scores"].query("share == 1")
    rows = rows.assign(predictor=rows["predictor"].map(style.label))
    return _shown(rows, "user predictor", pct="accuracy ci_low ci_high balanced missed calibration_error")


def effects(results: Results) -> Table:
    """Return what adding each kind does to each user's accepted share of paths, and the verdict."""
    return _shown(results.tables["interventions"], "user kind verdict", effect="effect ci_low ci_high lowest highest")


def envelopes(results: Results) -> Table:
    """Return the distance that each user keeps from each kind."""
    return _shown(results.tables["distances"], "user kind", cm="radius_m ci_low ci_high")


def repairs(results: Results) -> Table:
    """Return the first repairs of each user's invalid demonstrations."""
    rows = results.tables["repaired"].groupby("user", sort=False).head(FIRST_REPAIRS)
    return _shown(rows, "user scene demo", rate="p_before p_after", cm="moved_m")


def scenes_to_show(results: Results) -> Table:
    """Return the scenes about which each user's models disagree most."""
    rows = results.tables["disagreement"].groupby("user", sort=False).head(FIRST_SCENES)
    rows = rows.assign(shown=rows["shown"].map({True: "yes", False: "no"}))
    return _shown(rows, "user scene shown", fine="disagreement")


def learning(results: Results) -> Table:
    """Return accuracy by share of the training scenes."""
    scores = results.tables["scores"]
    rows = scores[scores["predictor"] == VARIANT]
    return _shown(rows, "user", pct="share accuracy ci_low ci_high")
