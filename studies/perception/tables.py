"""Items found by kind of table top and detector."""

import pandas as pd

from pipeline.report.page import Table
from pipeline.report.study import Study

DETECTORS = {
    "finder": "Hand-tuned finder",
    "segmenter": "Segmenter",
    "segmenter_empty": "Segmenter, empty table known",
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
