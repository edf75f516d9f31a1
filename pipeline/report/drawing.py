"""Drawings shared by pages: a table with paths, and a map of P(valid) over control points."""

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

Texts = Sequence[str]


def panels(
    rows: int, columns: int, width: float, height: float, titles: Texts = (), names: Texts = (), **options
) -> tuple[Figure, Array]:
    """Return a figure [inches] with a grid of axes (rows, columns): `titles` over its columns, `names` of its rows."""
    with matplotlib.rc_context(style.RC):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False, **options)
    for panel, title in zip(axes[0], titles, strict=False):
        panel.set_title(title)
    for panel, name in zip(axes[:, 0], names, strict=False):
        panel.set_ylabel(name, color=style.INK)
    return figure, axes


def draw_table(
    axes: Axes, image: Array, layouts: Layouts | None = None, scene: int = 0, margins: Margins | None = None
) -> None:
    """Draw a table from above, with dashed lines at the user's margins around its items."""
    axes.imshow(fewer_levels(image), extent=(0, 1, 0, 1), interpolation="none")
    _hide_axes(axes)
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


def draw_path(axes: Axes, z_theta: Array, colour: str, width: float = 2.5, rim: str = "#111417", **line: Any) -> None:
    """Draw the Bezier path of one control point [m], with an outline for contrast on any table top."""
    parabola = Path([P_INIT, np.asarray(z_theta, float), P_F], [Path.MOVETO, Path.CURVE3, Path.CURVE3])
    style = {"facecolor": "none", "capstyle": "butt"}
    axes.add_patch(PathPatch(parabola, edgecolor=rim, linewidth=width + 1.6, alpha=0.6, **style))
    axes.add_patch(PathPatch(parabola, edgecolor=colour, linewidth=width, **line, **style))
    axes.plot(*P_INIT, "o", *P_F, "s", color="white", markersize=4.5, markeredgecolor="#111417")
    axes.set(xlim=(0, 1), ylim=(0, 1))


def draw_map(axes: Axes, p: Array, trace: Array | None = None) -> None:
    """Draw P(valid) (side, side) as [y, x] over control points, the table's edge, and a repair's steps (step, 2)."""
    axes.imshow(
        p, interpolation="none", origin="lower", extent=(Z_LOW, Z_HIGH, Z_LOW, Z_HIGH), cmap=style.MAP, vmin=0, vmax=1
    )
    outline_table(axes, "#8f8f8f")
    if trace is not None:
        axes.plot(*trace.T, color="#111417", linewidth=3.2)
        axes.plot(*trace.T, color="white", linewidth=1.6)
        for place, mark, size in ((trace[0], "o", 8), (trace[-1], "*", 13)):
            axes.plot(*place, mark, color="white", markersize=size, markeredgecolor="#111417")
    axes.set(xlim=(Z_LOW, Z_HIGH), ylim=(Z_LOW, Z_HIGH))


def outline_table(axes: Axes, colour: str) -> None:
    """Draw the table's edge as a broken line, and no axes."""
    axes.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], color=colour, linewidth=0.8, linestyle=(0, (3, 2)))
    _hide_axes(axes)


def _hide_axes(axes: Axes) -> None:
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def draw_images(rows: Mapping[str, Any], titles: Texts = ()) -> Figure:
    """Return a figure of images uint8 (image, 100, 100, 3) in named rows, with titles over the columns."""
    width = min(map(len, rows.values()))
    figure, axes = panels(len(rows), width, 2.5 * width, 2.6 * len(rows), titles, list(rows))
    for line, images in zip(axes, rows.values(), strict=True):
        for panel, image in zip(line, images, strict=False):
            draw_table(panel, image)
    return figure


def _capsule(ends: Array, radius: float) -> Array:
    """Return the outline (point, 2) of the capsule of `radius` around a segment (2, 2)."""
    bearing = np.arctan2(*(ends[1] - ends[0])[::-1])
    half = np.linspace(-np.pi / 2, np.pi / 2, 24)
    angle = np.concatenate([bearing + half, bearing + np.pi + half])
    centre = np.repeat(ends[::-1], 24, axis=0)
    return centre + radius * np.stack([np.cos(angle), np.sin(angle)], -1)
