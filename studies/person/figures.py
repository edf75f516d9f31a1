"""Draw what becomes of an effect of each size."""

import numpy as np
from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import panels
from pipeline.report.study import Study

COLOURS = {"effect": style.INVALID, "present": style.START, "negligible": style.VALID, "undecided": style.RULE}


def verdicts(study: Study) -> Figure:
    """Draw the share of each verdict by the share of near places that the person refuses."""
    table = study.table("power.csv", finite=("within", "share"))
    figure, axes = panels(1, 1, 6.4, 3.4)
    panel, sizes = axes[0, 0], table["within"].unique()
    below = np.zeros(len(sizes))
    for word, colour in COLOURS.items():
        shares = table.loc[table["verdict"] == word, "share"].to_numpy()
        panel.bar(range(len(sizes)), shares, bottom=below, color=colour, label=word, width=0.8)
        below = below + shares
    panel.set_xticks(range(len(sizes)), [f"−{size:.2f}" if size else "0" for size in sizes])
    panel.set(xlabel="true effect without lapses", ylabel="share of people", ylim=(0, 1))
    panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    return figure
