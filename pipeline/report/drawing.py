"""Drawings shared by pages: a table with paths, a map of P(valid) over control points, bars and intervals."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon
from matplotlib.path import Path
from numpy import ndarray as Array

from pipeline.report import style
from pipeline.world.bezier import P_F, P_INIT, Z_HIGH, Z_LOW
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import Margins


def panels(rows: int, columns: int, width: float, height: float, **options) -> tuple[Figure, Array]:
    """Return a figure [inches] with a grid of axes (rows, columns) in the shared style."""
    with matplotlib.rc_context(style.RC):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, axes


def draw_table(
    axes: Axes, image: Array, layouts: Layouts | None = None, scene: int = 0, margins: Margins | None = None
) -> None:
    """Draw a table from above, with dashed lines at the user's margins around its items."""
    axes.imshow(fewer_levels(image), extent=(0, 1, 0, 1), interpolation="none")
    _bare(axes)
    if layouts is None or margins is None:
        return
    for slot in np.flatnonzero(layouts.present[scene]):
        margin = margins[SYMBOLS[layouts.symbol[scene, slot]]]
        if margin is not None:
            outline = _capsule(layouts.ends[scene, slot], layouts.radius[scene, slot] + margin)
            axes.add_patch(Polygon(outline, fill=False, edgecolor="white", linewidth=1.2, linestyle=(0, (3, 2))))


def fewer_levels(image: Array) -> Array:
    """Return a uint8 image with 32 levels a channel, whose PNG is half as large: the camera's noise hides the steps."""
    return (image & 0xF8) | 4


def draw_path(axes: Axes, z_theta: Array, colour: str, width: float = 2.5, linestyle: Any = "-") -> None:
    """Draw the Bezier path of one control point [m], with a dark outline for contrast on any table top."""
    parabola = Path([P_INIT, np.asarray(z_theta, float), P_F], [Path.MOVETO, Path.CURVE3, Path.CURVE3])
    style = {"facecolor": "none", "capstyle": "butt"}
    axes.add_patch(PathPatch(parabola, edgecolor="#111417", linewidth=width + 1.6, alpha=0.6, **style))
    axes.add_patch(PathPatch(parabola, edgecolor=colour, linewidth=width, linestyle=linestyle, **style))
    axes.plot(*P_INIT, "o", *P_F, "s", color="white", markersize=4.5, markeredgecolor="#111417")
    axes.set(xlim=(0, 1), ylim=(0, 1))


def draw_map(axes: Axes, p: Array, trace: Array | None = None) -> None:
    """Draw P(valid) (side, side) as [y, x] over control points, the table's edge, and a repair's steps (step, 2)."""
    axes.imshow(
        p, interpolation="none", origin="lower", extent=(Z_LOW, Z_HIGH, Z_LOW, Z_HIGH), cmap=style.MAP, vmin=0, vmax=1
    )
    axes.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], color="#8f8f8f", linewidth=0.8, linestyle=(0, (3, 2)))
    if trace is not None:
        axes.plot(*trace.T, color="#111417", linewidth=3.2)
        axes.plot(*trace.T, color="white", linewidth=1.6)
        for place, mark, size in ((trace[0], "o", 8), (trace[-1], "*", 13)):
            axes.plot(*place, mark, color="white", markersize=size, markeredgecolor="#111417")
    _bare(axes)
    axes.set(xlim=(Z_LOW, Z_HIGH), ylim=(Z_LOW, Z_HIGH))


def draw_intervals(
    axes: Axes, groups: Sequence[str], series: Mapping[str, Sequence[tuple[float, float, float]]], unit: float = 100.0
) -> None:
    """Draw (mean, low, high) of each series in each group as horizontal intervals, the first group at the top."""
    for i, (name, rows) in enumerate(series.items()):
        offset = 0.28 * (2 * i / max(len(series) - 1, 1) - 1)
        y = np.arange(len(groups)) + offset
        mean, low, high = unit * np.array(rows, float).T
        rim = style.INK if name == "paper" else style.colour(name)
        axes.hlines(y, low, high, color=rim, linewidth=2)
        marks: dict[str, Any] = {"marker": style.marker(name), "color": style.colour(name), "markeredgecolor": rim}
        axes.plot(mean, y, linestyle="", markersize=7, label=style.label(name), **marks)
    axes.set_yticks(range(len(groups)), list(groups))
    axes.set_ylim(len(groups) - 0.5, -0.5)
    axes.grid(axis="x")


def label_ends(axes: Axes, x: int, ends: Mapping[str, float], gap: float = 0.055) -> None:
    """Write the names of series beside their last points (x, y), at least `gap` of the axis apart, as toggles."""
    low, high = axes.get_ylim()
    y, places = -np.inf, {}
    for name in sorted(ends, key=ends.__getitem__):
        y = places[name] = max(ends[name], y + gap * (high - low))
    over = max(0.0, y - high)
    for name, place in places.items():
        text = axes.annotate(style.label(name), (x, place - over), (16, 0), textcoords="offset points", va="center")
        mark = axes.annotate("●", (x, place - over), (7, 0), textcoords="offset points", va="center", ha="center")
        mark.set(color=style.colour(name), fontsize=8)
        style.of_series(mark, name)
        style.toggles(text, name)


def _capsule(ends: Array, radius: float) -> Array:
    """Return the outline (point, 2) of the capsule of `radius` around a segment (2, 2)."""
    bearing = np.arctan2(*(ends[1] - ends[0])[::-1])
    half = np.linspace(-np.pi / 2, np.pi / 2, 24)
    angle = np.concatenate([bearing + half, bearing + np.pi + half])
    centre = np.repeat(ends[::-1], 24, axis=0)
    return centre + radius * np.stack([np.cos(angle), np.sin(angle)], -1)


def _bare(axes: Axes) -> None:
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
