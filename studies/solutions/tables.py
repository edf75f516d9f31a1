"""Verdicts, and the numbers behind them: clusters, overlaps and samples."""

import pandas as pd

from pipeline.report import style
from pipeline.report.page import Table
from pipeline.report.study import Study

CLUSTERS = {
    "nearest label": "Valid or not, by the nearest path in the table",
    "nearest neighbours": "User, by nearest paths in other tables",
    "nearest centroid": "User, by the nearest mean path",
    "silhouette": "Silhouette of users",
    "perfect, position": "User, perfect clusterer",
    "perfect, table known": "User, perfect clusterer, table known",
}
SOURCES = {"truth": "Valid paths (truth)", "training_mean": "Mean of training scenes (image-blind)"}


def verdicts(study: Study) -> Table:
    """Return what each claim is judged by: the interval must lie above the bar."""
    table = study.table("verdicts.csv", finite=("bar", "ours", "ci_low", "ci_high"))
    columns = {"claim": "Claim", "measure": "Measure", "bar": "Bar", "ours": "Ours", "ci_low": "low", "ci_high": "high"}
    frame = table[[*columns, "verdict"]].rename(columns=columns | {"verdict": "Holds in our world?"})
    return Table(frame, dict.fromkeys(["Bar", "Ours", "low", "high"], "fine"))


def clusters(study: Study) -> Table:
    """Return each measure of clustering with its interval, chance and p."""
    table = study.table("clusters.csv", finite=("mean", "ci_low", "ci_high", "chance"))
    table = table.set_index("measure").loc[list(CLUSTERS)].reset_index()
    names = {"measure": "Measure", "mean": "Mean", "ci_low": "low", "ci_high": "high", "chance": "By chance", "p": "p"}
    frame = table.assign(measure=table["measure"].map(CLUSTERS))[list(names)].rename(columns=names).astype(object)
    formats = dict.fromkeys(["Mean", "low", "high", "By chance"], "rate") | {"p": "fine"}
    return Table(frame.where(frame.notna(), None), formats)


def overlap(study: Study) -> Table:
    """Return the mean overlap of each pair of users by each source, its error and its correlation with the truth."""
    table = study.table("overlap.csv", finite=("truth", "overlap", "error", "correlation"))
    frame = pd.DataFrame(
        {
            "Users": table["first"] + ", " + table["second"],
            "According to": [_name(variant) for variant in table["variant"]],
            "True overlap": table["truth"],
            "Overlap": table["overlap"],
            "Mean error": table["error"],
            "Correlation": table["correlation"],
        }
    )
    return Table(frame, dict.fromkeys(frame.columns[2:], "rate"))


def sampling(study: Study) -> Table:
    """Return the share of valid samples, and the routes found among them, by user and source."""
    table = study.table("sampling.csv", finite=("valid", "routes", "routes_found", "routes_all"))
    frame = pd.DataFrame(
        {
            "User": table["user"],
            "Sampled from": [_name(variant) for variant in table["variant"]],
            "Valid": table["valid"],
            "low": table["valid_low"],
            "high": table["valid_high"],
            "Routes found": table["routes_found"],
            "Routes there are": table["routes_all"],
        }
    )
    formats = dict.fromkeys(["Valid", "low", "high"], "pct1") | dict.fromkeys(frame.columns[5:], "times")
    return Table(frame, formats)


def _name(variant: str) -> str:
    return SOURCES.get(variant) or style.label(variant)
