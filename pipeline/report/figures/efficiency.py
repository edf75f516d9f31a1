"""Accuracy against training scenes, and whether labels are better spent on scenes or on demonstrations in each."""

import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator, PercentFormatter

from pipeline.report.results import POSITION
from pipeline.report.style import INK, MUTED, colour, line, marker
from pipeline.report.wording import variant_label

DEEPER = (0, (3, 1.5))


def draw(curve: pd.DataFrame, variants: list[str], own: int, n: int, null: float, threshold: float) -> Figure:
    """Means with a band between the quartiles over seeds, against scenes of `n` demonstrations and against labels.

    curve: variant, scenes, n, demonstrations, mean, q1, q3 (shares of 1); more demonstrations a scene, broken, in
    `own` scenes.
    """
    figure = Figure((4.2, 6.0), layout="constrained")
    axes = figure.subplots(2)
    wider, deeper = curve[curve["n"] == n], curve[curve["scenes"] == own]
    for variant in variants:
        _line(axes[0], wider, "scenes", variant, "-")
        _line(axes[1], wider, "demonstrations", variant, "-")
        _line(axes[1], deeper, "demonstrations", variant, DEEPER)
    for ax, label, ticks in (
        (axes[0], f"training scenes, n = {n}", wider["scenes"]),
        (axes[1], "demonstrations in all", [20, 50, 100, 200, 400]),
    ):
        ax.axhline(null, color=MUTED, ls=line(POSITION), lw=1.2)
        ax.axhline(threshold, color=MUTED, lw=0.6)
        ax.set_xscale("log")
        ax.set_xticks(sorted(set(ticks)), [str(tick) for tick in sorted(set(ticks))])
        ax.xaxis.set_minor_locator(NullLocator())
        ax.set_xlabel(label)
        ax.set_ylim(0.45, 1.01)
        ax.set_yticks([0.6, 0.8, 1.0])
        ax.yaxis.set_major_formatter(PercentFormatter(1, decimals=0))
        ax.grid(axis="y")
    figure.supylabel("paths judged rightly", fontsize=9)
    handles = [Line2D([], [], color=colour(v), marker=marker(v), ms=4, lw=1.4) for v in variants]
    handles += [Line2D([], [], color=INK, lw=1.4, ls=ls) for ls in ("-", DEEPER)]
    handles.append(Line2D([], [], color=MUTED, lw=1.2, ls=line(POSITION)))
    texts = [*map(variant_label, variants), "more scenes", "more a scene", variant_label(POSITION)]
    figure.legend(handles, texts, loc="outside lower center", ncols=2, handlelength=2.6)
    return figure


def _line(ax, part: pd.DataFrame, x: str, variant: str, style) -> None:
    part = part[part["variant"] == variant].sort_values(x)
    ax.fill_between(part[x], part["q1"], part["q3"], color=colour(variant), alpha=0.15, lw=0)
    ax.plot(part[x], part["mean"], color=colour(variant), ls=style, marker=marker(variant), ms=4, lw=1.4)
