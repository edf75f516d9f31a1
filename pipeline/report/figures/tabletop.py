"""What every picture of a table shares: the scene in metres, footprints' outlines, paths, validity maps."""

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.axes import Axes
from matplotlib.patches import Polygon
from matplotlib.patheffects import Normal, Stroke
from numpy import ndarray as Array

from pipeline.report.style import CHALK, INK, INVALID, MUTED, VALID
from pipeline.table.bezier import P_F, P_INIT, Z_HIGH, Z_LOW, curve
from pipeline.table.layout import Layouts

SAMPLES = 33  # points drawn along a path
DASHES = (0.0, (2.6, 1.8))  # of an invalid path
MAP = "cividis"  # of probabilities: even in lightness, and the same to the colour-blind


def bare(axes: Axes) -> None:
    """No ticks, no frame."""
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


def draw_scene(axes: Axes, image: UInt8[Array, "100 100 3"], *, ends: bool = True) -> None:
    """The table from above, in metres, its two ends marked."""
    axes.imshow(image, extent=(0, 1, 0, 1), interpolation="none", zorder=0)
    if ends:
        halo = [Stroke(linewidth=2.2, foreground=INK), Normal()]
        for point, mark in ((P_INIT, "o"), (P_F, "s")):
            axes.plot(*point, mark, color=CHALK, ms=3.2, mew=0, path_effects=halo, zorder=5)
    axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
    bare(axes)


def draw_path(axes: Axes, z_theta: Float[Array, "2"], colour: str, *, width=1.2, dashed=False, halo=True) -> None:
    """One Bezier path from its control point [m], with a light rim so that it shows on any table."""
    points = curve(np.asarray(z_theta, dtype=float), SAMPLES)
    effects = [Stroke(linewidth=width + 1.1, foreground=CHALK, alpha=0.75), Normal()] if halo else None
    style = DASHES if dashed else "-"
    axes.plot(
        points[:, 0], points[:, 1], color=colour, lw=width, ls=style, path_effects=effects, zorder=3,
        dash_capstyle="butt", solid_capstyle="round",
    )  # fmt: skip


def draw_demonstration(axes: Axes, z_theta: Float[Array, "2"], valid: bool) -> None:
    """A labelled path: valid blue and whole, invalid vermilion and broken."""
    draw_path(axes, z_theta, VALID if valid else INVALID, dashed=not valid)


def draw_footprints(axes: Axes, layouts: Layouts, scene: int, colour: str = CHALK) -> None:
    """The outline of what stands in a scene."""
    for slot in np.flatnonzero(layouts.present[scene]):
        outline = capsule(layouts.ends[scene, slot], float(layouts.radius[scene, slot]))
        axes.add_patch(Polygon(outline, fill=False, edgecolor=colour, lw=0.8, zorder=2))


def capsule(ends: Float[Array, "2 2"], radius: float) -> Float[Array, "point 2"]:
    """The outline [m] of all points within `radius` of a segment."""
    along = ends[1] - ends[0]
    bearing = np.arctan2(along[1], along[0]) if np.any(along) else 0.0
    half = np.linspace(-np.pi / 2, np.pi / 2, 17)
    arcs = [ends[1 - i] + radius * _unit(bearing + i * np.pi + half) for i in (0, 1)]
    return np.concatenate(arcs)


def _unit(angle: Array) -> Array:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def draw_map(axes: Axes, validity: Float[Array, "side side"]) -> None:
    """P(valid) by control point, [y, x] over the z_theta square; the table's edge as a thin frame."""
    square = (Z_LOW, Z_HIGH, Z_LOW, Z_HIGH)
    axes.imshow(validity, origin="lower", extent=square, vmin=0, vmax=1, cmap=MAP, interpolation="none")
    axes.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], color=CHALK, lw=0.6, ls=(0, (3, 3)))
    axes.set(xlim=(Z_LOW, Z_HIGH), ylim=(Z_LOW, Z_HIGH), aspect="equal")
    bare(axes)


def row_label(axes: Axes, text: str) -> None:
    """A label left of a row of pictures."""
    axes.set_ylabel(text, fontsize=8, color=MUTED, labelpad=5)
