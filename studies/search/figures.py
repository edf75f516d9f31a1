"""Every setting of the search against its validation result, a panel a learner."""

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from pipeline.report import style
from pipeline.report.drawing import panels
from pipeline.report.study import Study

COLUMNS = 3  # panels in a row


def searched(study: Study) -> Figure:
    """Draw each setting's result in the order drawn, ensembles last; a band is the default over initial weights."""
    table, learners = study.table("settings.csv", finite=("new_scenes",)), study.table("learners.csv")
    rows = -(-len(learners) // COLUMNS)
    figure, axes = panels(rows, COLUMNS, 12.0, 3.3 * rows + 0.4, sharex=True, sharey=True)
    for panel in axes.flat[len(learners) :]:
        panel.set_visible(False)
    for panel, row in zip(axes.flat, learners.to_dict("records"), strict=False):
        learner, settings = row["learner"], table[table["learner"] == row["learner"]]
        low, high = (100 * (row["default"] + sign * 2 * row["spread"]) for sign in (-1, 1))
        panel.axhspan(low, high, color=style.MUTED, alpha=0.25, linewidth=0)
        panel.axhline(100 * row["default"], color=style.INK, linewidth=1, label="default, ± 2 standard deviations")
        single = settings[settings["origin"] == "sampled"]
        without_gate = single["reconstruction_over_flat"].isna()  # learners without a decoder
        converged = single["passed"].astype(bool) | without_gate
        for passed, fill in ((True, style.colour(learner)), (False, "none")):
            shown = single[converged == passed]
            label = "setting, converged" if passed else "setting, not converged"
            marks = {"facecolors": fill, "edgecolors": style.colour(learner)}
            panel.scatter(shown["number"], 100 * shown["new_scenes"], s=18, label=label, **marks)
        ensembles = settings[settings["origin"] == "ensemble"]
        after = single["number"].max() + 2 + np.arange(len(ensembles))
        panel.scatter(after, 100 * ensembles["new_scenes"], s=42, marker="*", color=style.INK, label="ensemble")
        panel.set(title=style.label(learner), ylim=(45, 101))
        panel.grid(axis="y")
    for panel in axes[-1]:
        panel.set_xlabel("number of the setting")
        panel.xaxis.set_major_locator(MaxNLocator(integer=True))
    for panel in axes[:, 0]:
        panel.set_ylabel("balanced accuracy, per cent")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4, fontsize=10)
    return figure
