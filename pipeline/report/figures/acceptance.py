"""Paths accepted with a promise: what became of it, and how many of the valid paths it let through."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.report.style import INK, MUTED, colour, marker
from pipeline.report.wording import rule_label, variant_label

LINES = {"split": "-", "crossed": (0, (4, 2)), "training": (0, (1, 1.5))}
TICKS = (0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
LINEAR = 0.01  # below it the axis is linear, so that 0 has a place


def draw(curve: pd.DataFrame, titles: dict[str, str], promise: float) -> Figure:
    """Per split, one above the other: share of invalid paths among the accepted ones and of valid ones let through.

    curve: variant, split, rule, level, false and power (with limits), abstained (stage accept); titles: of the splits.
    One form for pages of any width: a line of text on a phone is as wide.
    """
    figure = Figure((4.2, 5.0), layout="constrained")
    axes = figure.subplots(2, len(titles), squeeze=False, sharex=True, sharey="row")
    shown = curve[curve["rule"].isin(list(LINES))]
    levels = sorted(set(curve["level"]))
    top = 1.3 * max(levels[-1], shown["false"].max())
    for (split, title), (above, below) in zip(titles.items(), axes.T, strict=True):
        above.plot(levels, levels, color=MUTED, lw=0.8)
        for (variant, rule), rows in shown[shown["split"] == split].groupby(["variant", "rule"], sort=False):
            _line(above, rows[rows["abstained"] < 1], "false", str(variant), str(rule))
            _line(below, rows, "power", str(variant), str(rule))
        for ax in (above, below):
            ax.axvline(promise, color=MUTED, lw=0.6, ls=(0, (2, 2)))
            ax.grid(axis="y")
        above.set_title(title, loc="left")
    axes[0, 0].set_yscale("symlog", linthresh=LINEAR)
    axes[0, 0].set(ylabel="invalid among accepted", ylim=(-LINEAR / 20, top))
    axes[0, 0].set_yticks([t for t in TICKS if t <= top], [_percent(t) for t in TICKS if t <= top])
    axes[1, 0].set(ylabel="accepted of the valid", ylim=(-0.03, 1.03), xscale="log")
    axes[1, 0].set_yticks([0, 0.5, 1], ["0 %", "50 %", "100 %"])
    axes[1, 0].set_xticks(levels, [_percent(t) for t in levels])
    for ax in axes.ravel():
        ax.minorticks_off()
        ax.tick_params(axis="y", length=0)
    for ax in axes[1]:
        ax.set_xlabel("promise")
    variants = list(dict.fromkeys(curve["variant"]))
    handles = [Line2D([], [], color=colour(v), marker=marker(v), ms=4) for v in variants]
    handles += [Line2D([], [], color=INK, ls=style) for style in LINES.values()]
    texts = [*map(variant_label, variants), *map(rule_label, LINES)]
    figure.legend(handles, texts, loc="outside lower center", ncols=2, handlelength=2.6)
    return figure


def _percent(share: float) -> str:
    return f"{100 * share:g} %"


def _line(ax: Axes, rows: pd.DataFrame, name: str, variant: str, rule: str) -> None:
    """One rule's line; the split form's, whose promise it is, with marks and the band of its interval."""
    mark = marker(variant) if rule == "split" else None
    ax.plot(rows["level"], rows[name], color=colour(variant), ls=LINES[rule], marker=mark, ms=4, lw=1.2)
    if rule == "split":
        limits = rows[f"{name}_low"], rows[f"{name}_high"]
        ax.fill_between(rows["level"], *limits, color=colour(variant), alpha=0.15, lw=0)
