"""Composites with the objects that the segmenter finds, and the worst effect of an added item."""

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pipeline.report.drawing import draw_table, panels
from pipeline.report.study import Study
from pipeline.world.layout import point_segment_distance

SHOWN = 6  # pictures, of families held out
GRID = np.stack(np.meshgrid(*[np.linspace(0, 1, 201)] * 2), -1)  # points of the table [m]


def strip(study: Study) -> Figure:
    """Draw pictures of families held out, with the outlines found without the empty table's picture."""
    examples = study.arrays("examples.npz")
    table = study.table("families.csv")
    families = table.loc[table["kind"] == "held_out", "family"].unique()[:SHOWN]
    figure, axes = panels(1, len(families), 2.1 * len(families), 2.3)
    for panel, family in zip(axes[0], families, strict=True):
        draw_table(panel, examples[f"{family}.image"][0])
        panel.set_title(family.replace("_", " "))
        radii, ends = (examples[f"{family}.segmenter.{name}"][0] for name in ("radius", "ends"))
        for i in np.flatnonzero(np.isfinite(radii)):
            away = point_segment_distance(GRID, *ends[i])
            panel.contour(GRID[..., 0], GRID[..., 1], away, [radii[i]], colors="white", linewidths=1.4)
    return figure


def furthest(study: Study) -> pd.DataFrame:
    """Return for each split and detector the effect furthest from the truth, and how many verdicts are `right`."""
    parts = study.table("verdicts.csv").groupby(["source", "detector"], sort=False)
    worst = [part.loc[[(part["effect"] - part["truth"]).abs().idxmax()]] for _, part in parts]
    right = [f"{part['right'].sum()} of {len(part)}" for _, part in parts]
    return pd.concat(worst).assign(right=right)
