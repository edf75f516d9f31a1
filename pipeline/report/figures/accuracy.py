"""Accuracy against demonstrations per scene: the paper's Figure "model_perf", with nulls and per split."""

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.ticker import PercentFormatter

from pipeline.report import paper
from pipeline.report.style import INK, colour, line, marker
from pipeline.report.wording import split_label, variant_label


def draw(summary: pd.DataFrame, splits: list[str], columns: int) -> Figure:
    """Lines of the mean with a band between the quartiles over seeds.

    summary: variant, split, n, mean, q1, q3 (shares of 1). Paper: its mean and quartiles at n = 1 and 9.
    """
    rows = -(-len(splits) // columns)
    key_height = 0.6 if columns > 1 else 1.25
    size = (3.1 * columns, 2.75 * rows + key_height) if columns > 1 else (4.2, 2.7 * rows + key_height)
    figure = Figure(size, layout="constrained")
    figure.get_layout_engine().set(rect=(0, key_height / size[1], 1, 1 - key_height / size[1]))  # pyright: ignore
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel()
    handles: dict = {}
    for ax, split in zip(axes, splits, strict=False):
        panel = summary[summary["split"] == split]
        for variant in panel["variant"].unique():
            handles.setdefault(variant_label(variant), _line(ax, panel[panel["variant"] == variant], variant))
        handles.setdefault("Paper (mean, quartiles)", _paper(ax))
        ax.axhline(0.5, color=INK, lw=0.4, alpha=0.5)
        ax.set_title(split_label(split), loc="left")
        ax.set_xlabel("demonstrations per scene, n")
        ax.set_xticks(sorted(panel["n"].unique()))
        ax.set_ylim(0.45, 1.01)
        ax.yaxis.set_major_formatter(PercentFormatter(1, decimals=0))
        ax.grid(axis="y")
    for ax in axes[::columns]:
        ax.set_ylabel("paths judged rightly")
    names = sorted(handles, key=lambda name: name.startswith(("Null", "Paper")))
    figure.legend(
        [handles[x] for x in names], names, loc="lower center", ncols=4 if columns > 1 else 2, handlelength=2.6
    )
    return figure


def _line(ax, part: pd.DataFrame, variant: str):
    part = part.sort_values("n")
    null = variant.startswith("null")
    ax.fill_between(part["n"], part["q1"], part["q3"], color=colour(variant), alpha=0.12 if null else 0.2, lw=0)
    mark = None if null else marker(variant)
    return ax.plot(part["n"], part["mean"], color=colour(variant), ls=line(variant), marker=mark, ms=4, lw=1.4)[0]


def _paper(ax):
    ns = list(paper.ACCURACY)
    mean = [paper.ACCURACY[n].mean for n in ns]
    low = [paper.ACCURACY[n].mean - paper.ACCURACY[n].q1 for n in ns]
    high = [paper.ACCURACY[n].q3 - paper.ACCURACY[n].mean for n in ns]
    return ax.errorbar(ns, mean, yerr=[low, high], fmt="*", color=INK, ms=8, mew=0, elinewidth=1, capsize=2)
