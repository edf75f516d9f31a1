"""Placebo patches on one table, and the effects that models report where there is none."""

import numpy as np
from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_images, panels
from pipeline.report.study import Study
from pipeline.world.symbols import SYMBOLS
from studies.refutation.tables import name_of

MODELS = ("full", "irl_ranked", "clearance")
NEGLIGIBLE = 0.05  # smallest effect of interest


def placebos(study: Study) -> Figure:
    """Draw the first table with each item's pixels shuffled, a row for each size of the pieces."""
    images = study.arrays("examples.npz")
    rows = {f"{setting.partition('=')[2]} px pieces": list(versions) for setting, versions in images.items()}
    return draw_images(rows, [f"placebo of {symbol}" for symbol in SYMBOLS])


def effects(study: Study) -> Figure:
    """Draw the effect in every question by refuter, a panel for each model; hollow where the refuter is not passed."""
    table = study.table("summary.csv", finite=("effect",))
    table = table[table["refuter"] != "data_subset"]
    groups = list(dict.fromkeys(zip(table["refuter"], table["setting"], strict=True)))
    shown = [variant for variant in MODELS if variant in study.variants]
    figure, axes = panels(1, len(shown), 4.2 * len(shown) + 0.8, 0.9 + 0.5 * len(groups), sharey=True, sharex=True)
    for panel, variant in zip(axes[0], shown, strict=True):
        panel.axvspan(-NEGLIGIBLE, NEGLIGIBLE, color=style.RULE, alpha=0.5, linewidth=0)
        for i, (refuter, setting) in enumerate(groups):
            rows = table[(table["variant"] == variant) & (table["refuter"] == refuter) & (table["setting"] == setting)]
            y = i + np.linspace(-0.28, 0.28, max(len(rows), 2))[: len(rows)]
            for passed, fill in ((True, style.colour(variant)), (False, "none")):
                at = (rows["passed"].astype(bool) == passed).to_numpy()
                marks = {"markerfacecolor": fill, "markeredgecolor": style.colour(variant), "markersize": 6}
                panel.plot(rows["effect"][at], y[at], style.marker(variant), **marks)
        panel.set_yticks(range(len(groups)), [name_of(*group) for group in groups])
        panel.set(title=style.label(variant), xlabel="effect on P(valid)", ylim=(len(groups) - 0.5, -0.5))
        panel.grid(axis="x")
    return figure
