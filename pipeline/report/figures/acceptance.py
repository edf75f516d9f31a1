"""Paths accepted with a promise: what became of it, and how many of the valid paths it let through."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from pipeline.report.style import INK, MUTED, colour, marker
from pipeline.report.wording import rule_label, split_label, variant_label

LINES = {"split": "-", "crossed": (0, (4, 2)), "training": (0, (1, 1.5))}
TICKS = (0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1)
LINEAR = 0.01  # below it axes are linear, so that 0 has a place


def draw(curve: pd.DataFrame, splits: list[str], promise: float, columns: int) -> Figure:
    """Per split two panels, share of invalid among accepted and share of valid accepted, against the promise.

    curve: variant, split, rule, level, false (with its limits), power, abstained (stage accept).
    """
    size = (7.4, 5.8) if columns > 1 else (4.2, 3.0 * 2 * len(splits))
    figure = Figure(size, layout="constrained")
    shape = (2, len(splits)) if columns > 1 else (2 * len(splits), 1)
    panels = figure.subplots(*shape, squeeze=False, sharex=True)
    pairs = panels.T if columns > 1 else panels.reshape(-1, 2)
    levels = curve["level"].to_numpy()
    for split, (ax, below) in zip(splits, pairs, strict=True):
        part = curve[curve["split"] == split]
        ax.plot([0, levels.max()], [0, levels.max()], color=MUTED, lw=0.8)
        for (variant, rule), rows in part[part["rule"].isin(list(LINES))].groupby(["variant", "rule"], sort=False):
            _line(ax, rows, "false", variant, rule, rows["abstained"].to_numpy() < 1)
            _line(below, rows, "power", variant, rule, np.ones(len(rows), dtype=bool))
        ax.set_title(split_label(split), loc="left")
        ax.set_ylabel("invalid among accepted")
        below.set_ylabel("accepted of the valid")
        below.set_ylim(-0.03, 1.03)
        ax.set_yscale("symlog", linthresh=LINEAR)
        top = max(levels.max(), part.loc[part["rule"].isin(list(LINES)), "false"].max())
        ax.set_ylim(-0.0006, 1.3 * top)
        ax.set_yticks([t for t in TICKS if t <= 1.3 * top], [f"{100 * t:g} %" for t in TICKS if t <= 1.3 * top])
        ax.set_yticks([], minor=True)
        below.set_xlabel("promise: at most so many invalid")
        for panel in (ax, below):
            panel.axvline(promise, color=MUTED, lw=0.6, ls=(0, (2, 2)))
            panel.set_xscale("log")
            panel.set_xticks(sorted(set(levels)), [f"{100 * t:g} %" for t in sorted(set(levels))])
            panel.set_xticks([], minor=True)
            panel.tick_params(labelbottom=True)
            panel.grid()
    variants = list(dict.fromkeys(curve["variant"]))
    handles = [Line2D([], [], color=colour(v), marker=marker(v), ms=4) for v in variants]
    handles += [Line2D([], [], color=INK, ls=style) for style in LINES.values()]
    texts = [variant_label(v) for v in variants] + [rule_label(rule) for rule in LINES]
    handles.append(Line2D([], [], color=MUTED, lw=0.8))
    texts.append("As promised")
    figure.legend(handles, texts, loc="outside lower center", ncols=3 if columns > 1 else 2, handlelength=2.6)
    return figure


def _line(ax: Axes, rows: pd.DataFrame, name: str, variant: str, rule: str, shown: np.ndarray) -> None:
    """One rule's line; the split form, whose promise it is, with the band of its interval."""
    rows = rows[shown]
    ax.plot(rows["level"], rows[name], color=colour(variant), ls=LINES[rule], marker=marker(variant), ms=3.5, lw=1.2)
    if rule == "split":
        limits = rows[f"{name}_low"], rows[f"{name}_high"]
        ax.fill_between(rows["level"], *limits, color=colour(variant), alpha=0.15, lw=0)
