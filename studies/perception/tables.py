"""Items found by kind of table top and detector."""

import pandas as pd

from pipeline.report.page import Table, with_gaps
from pipeline.report.study import Study

DETECTORS = {
    "finder": "Hand-tuned finder",
    "segmenter": "Segmenter",
    "segmenter_empty": "Segmenter, empty table known",
}
SOURCES = {
    "val_scenes": "drawn, items known",
    "val_items": "drawn, items unseen",
    "validation_taught": "path-traced, tops taught",
    "validation_held_out": "path-traced, tops held out",
}
KINDS = {"taught": "taught", "held_out": "held out"}


def by_kind(study: Study) -> Table:
    """Return recall, outlines and errors of each detector on families of tops taught and held out."""
    table = study.table("summary.csv", finite=("recall", "iou", "made_up"))
    shown = pd.DataFrame(
        {
            "Table tops": table["kind"].map(KINDS), "Detector": table["detector"].map(DETECTORS),
            "Items": table["items"], "Found": table["recall"], "Overlap": table["iou"], "Made up": table["made_up"],
        }
    )  # fmt: skip
    return Table(shown, dict.fromkeys(["Found", "Overlap", "Made up"], "pct1"))


def by_source(study: Study) -> Table:
    """Return the mean accuracy over users in each source and, path-traced, on each kind of table top."""
    table = study.table("accuracy.csv", finite=("accuracy",)).assign(source=lambda rows: rows["source"].map(SOURCES))
    by_top = table.groupby(["source", "top", "detector"], sort=False).mean(numeric_only=True)
    weighted = table.assign(accuracy=table["accuracy"] * table["scenes"]).groupby(["source", "detector"], sort=False)
    whole = (weighted["accuracy"].sum() / weighted["scenes"].sum()).unstack()[list(DETECTORS)]
    path_traced = by_top["accuracy"].unstack()[list(DETECTORS)].drop("drawn", level="top")
    whole.index = pd.MultiIndex.from_product([whole.index, ["all"]])
    shown = pd.concat([whole, path_traced]).rename_axis(["Source", "Table tops"]).rename(columns=DETECTORS)
    order = shown.index.get_level_values(0).map(list(SOURCES.values()).index)
    shown = shown.iloc[order.argsort(kind="stable")].reset_index()
    return Table(with_gaps(shown), dict.fromkeys(DETECTORS.values(), "pct1"))
