"""Learning curves: the training loss of each variant over its steps."""

import pandas as pd
from matplotlib.figure import Figure

from pipeline.report.style import INVALID, MUTED, VALID
from pipeline.report.wording import variant_label

LOOKS = ((VALID, "-"), (INVALID, (0, (5, 1.5))), (MUTED, (0, (1.2, 1.4))))  # user by user


def draw(curves: dict[str, pd.DataFrame], users: list[str], columns: int) -> Figure:
    """curves: variant -> seed, user, step, total; the mean over seeds with a band between the quartiles."""
    rows = -(-len(curves) // columns)
    figure = Figure(((9.3 / 3) * columns if columns > 2 else 4.2, 1.9 * rows + 0.45), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    handles: dict = {}
    for ax, (variant, frame) in zip(axes, curves.items(), strict=False):
        for user, (colour, line) in zip(users, LOOKS * len(users), strict=False):
            by_step = frame[frame["user"] == user].groupby("step")["total"]
            mean, low, high = by_step.mean(), by_step.quantile(0.25), by_step.quantile(0.75)
            if len(mean) < 2:
                continue
            ax.fill_between(mean.index, low, high, color=colour, alpha=0.2, lw=0)
            handles.setdefault(user, ax.plot(mean.index, mean, color=colour, ls=line, lw=1.2)[0])
        ax.set_title(variant_label(variant), loc="left")
        ax.set_xlabel("step")
        ax.grid(axis="y")
    for ax in axes[len(curves) :]:
        ax.set_visible(False)
    for ax in axes[::columns]:
        ax.set_ylabel("training loss")
    if handles:
        figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=3, handlelength=3)
    return figure
