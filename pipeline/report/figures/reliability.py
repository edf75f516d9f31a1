"""Reliability diagram: how often paths are valid that a model gives the same probability."""

import pandas as pd
from matplotlib.figure import Figure

from pipeline.report.style import MUTED, colour, line, marker
from pipeline.report.wording import split_label, variant_label

FEWEST = 30  # paths in a bin, below which its frequency is noise and is not drawn


def draw(calibration: pd.DataFrame, splits: list[str], columns: int) -> Figure:
    """calibration: variant, split, count, confidence, frequency; one panel per split."""
    rows = -(-len(splits) // columns)
    size = (3.1 * columns, 2.8 * rows + 0.6) if columns > 1 else (4.2, 3.3 * rows + 0.9)
    figure = Figure(size, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    handles: dict = {}
    shown = calibration[(calibration["count"] >= FEWEST) & (calibration["variant"] != "null_nearest")]
    for ax, split in zip(axes, splits, strict=True):
        ax.plot([0, 1], [0, 1], color=MUTED, lw=0.8)
        panel = shown[shown["split"] == split]
        for variant in calibration["variant"].unique():
            part = panel[panel["variant"] == variant].sort_values("confidence")
            if part.empty:
                continue
            mark = None if variant.startswith("null") else marker(variant)
            drawn = ax.plot(
                part["confidence"],
                part["frequency"],
                color=colour(variant),
                ls=line(variant),
                marker=mark,
                ms=3.5,
                lw=1.2,
            )[0]
            handles.setdefault(variant_label(variant), drawn)
        ax.set_title(split_label(split), loc="left")
        ax.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xlabel="predicted P(valid)")
        ax.grid()
    for ax in axes[::columns]:
        ax.set_ylabel("share truly valid")
    figure.legend(
        handles.values(), handles.keys(), loc="outside lower center", ncols=3 if columns > 1 else 2, handlelength=2.6
    )
    return figure
