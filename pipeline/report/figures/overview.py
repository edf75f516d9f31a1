"""The whole experiment in one picture, for the README: demonstrations, validity maps, repairs, interventions."""

from dataclasses import dataclass

from jaxtyping import Bool, Float, UInt8
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from numpy import ndarray as Array

from pipeline.report.figures.interventions import forest, key
from pipeline.report.figures.repairs import Repair, draw_repair
from pipeline.report.figures.tabletop import draw_demonstration, draw_map, draw_scene
from pipeline.report.style import INK, MUTED
from pipeline.table.layout import Layouts

WIDER = 1.2  # width of the plot of effects, in pictures


@dataclass(frozen=True)
class UserRow:
    """What the picture shows of one user."""

    user: str
    image: UInt8[Array, "100 100 3"]  # a training scene, its demonstrations and its maps
    z: Float[Array, "n 2"]
    valid: Bool[Array, " n"]
    truth: Float[Array, "side side"]
    learned: Float[Array, "side side"]
    repair: Repair
    cells: dict[str, dict[str, dict]]  # variant -> symbol -> numbers


def draw(
    rows: list[UserRow], images: UInt8[Array, "scene 100 100 3"], layouts: Layouts, label: str, smallest: float
) -> Figure:
    """One row a user; `images` and `layouts` are those of the repairs, `label` the model that is drawn."""
    figure = Figure((12.4, 2.4 * len(rows) + 0.85))
    grid = GridSpec(
        len(rows), 5, figure=figure, width_ratios=(1, 1, 1, 1, WIDER), left=0.028, right=0.945,
        top=0.945, bottom=0.125, wspace=0.07, hspace=0.10,
    )  # fmt: skip
    titles = (
        "1  Demonstrations",
        "2  Valid control points: truth",
        f"3  … as learned: {label}",
        "4  Gradient repair",
        "5  An added item’s effect",
    )
    ends = [
        c[k] for row in rows for by in row.cells.values() for c in by.values() for k in ("ci_low", "ci_high", "truth")
    ]
    reach = min(-2 * smallest, *ends) - 0.02, max(2 * smallest, *ends) + 0.02
    for i, row in enumerate(rows):
        axes = [figure.add_subplot(grid[i, j]) for j in range(5)]
        draw_scene(axes[0], row.image)
        for path, valid in zip(row.z, row.valid, strict=True):
            draw_demonstration(axes[0], path, bool(valid))
        draw_map(axes[1], row.truth)
        draw_map(axes[2], row.learned)
        draw_repair(axes[3], images, layouts, row.repair)
        forest(axes[4], row.cells, smallest)
        axes[4].yaxis.tick_right()
        axes[4].set_box_aspect(1 / WIDER)
        axes[4].spines["left"].set_visible(False)
        axes[4].set_xlim(*reach)
        axes[4].tick_params(axis="x", labelbottom=i == len(rows) - 1)
        axes[0].set_ylabel(f"{row.user.capitalize()} user", fontsize=11, color=INK, labelpad=6)
        if i == 0:
            for ax, title in zip(axes, titles, strict=True):
                ax.set_title(title, loc="left", fontsize=10.5)
        if i == len(rows) - 1:
            notes = (
                "whole line: valid; broken: invalid", "yellow: valid, blue: invalid", "P(valid) in a training scene",
                f"by the {label}, dark to light", "change of mean P(valid)",
            )  # fmt: skip
            for ax, note in zip(axes, notes, strict=True):
                ax.set_xlabel(note, fontsize=9, color=MUTED)
    handles, labels = key(list(rows[0].cells))
    figure.legend(handles, labels, loc="lower right", ncols=len(labels), bbox_to_anchor=(0.99, 0.0), handlelength=1.6)
    return figure
