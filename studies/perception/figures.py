"""Composites with the objects that each detector finds."""

import numpy as np
from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_table, panels
from pipeline.report.study import Study
from pipeline.world.layout import point_segment_distance
from studies.perception.tables import DETECTORS

SHOWN = 6  # pictures, of families held out
GRID = np.stack(np.meshgrid(*[np.linspace(0, 1, 201)] * 2), -1)  # points of the table [m]


def strip(study: Study) -> Figure:
    """Draw pictures of families held out, with the outlines found without the empty table's picture."""
    examples = study.arrays("examples.npz")
    table = study.table("families.csv")
    families = table.loc[table["kind"] == "held_out", "family"].unique()[:SHOWN]
    detectors = ("finder", "segmenter")
    figure, axes = panels(len(detectors), len(families), 2.1 * len(families), 2.3 * len(detectors))
    for line, detector in zip(axes, detectors, strict=True):
        line[0].set_ylabel(DETECTORS[detector], color=style.INK)
        for panel, family in zip(line, families, strict=True):
            draw_table(panel, examples[f"{family}.image"][0])
            radii = examples[f"{family}.{detector}.radius"][0]
            for i in np.flatnonzero(np.isfinite(radii)):
                away = point_segment_distance(GRID, *examples[f"{family}.{detector}.ends"][0, i])
                panel.contour(GRID[..., 0], GRID[..., 1], away, [radii[i]], colors="white", linewidths=1.4)
    for panel, family in zip(axes[0], families, strict=True):
        panel.set_title(family.replace("_", " "))
    return figure
