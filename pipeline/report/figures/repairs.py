"""Repairs in their scenes, dark to light over the gradient steps: the paper's Figure "packprop"."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib import colormaps
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import draw_footprints, draw_path, draw_scene
from pipeline.table.layout import Layouts

DRAWN = 7  # of the steps' paths, the first and the last among them
SHADES = "Blues_r"  # dark to light, as in the paper


@dataclass(frozen=True)
class Repair:
    """One start and where a model's gradient took it."""

    scene: int
    z: Float[Array, "step 2"]  # [m], the start first
    valid: bool  # the end, by the truth
    accepted: bool  # the end, by the model
    said: str | None = None  # below the picture, in place of what came of it


def draw(images: UInt8[Array, "scene 100 100 3"], layouts: Layouts, repairs: dict[str, list[Repair]]) -> Figure:
    """Rows: scenes; columns: users."""
    users = list(repairs)
    rows = len(repairs[users[0]])
    figure = Figure((1.75 * len(users), 1.92 * rows + 0.25), layout="constrained")
    axes = figure.subplots(rows, len(users), squeeze=False)
    for column, user in enumerate(users):
        for row, found in enumerate(repairs[user]):
            ax = axes[row, column]
            draw_repair(ax, images, layouts, found)
            ax.set_xlabel(found.said or _outcome(found), fontsize=8, labelpad=2)
            if row == 0:
                ax.set_title(user.capitalize())
    return figure


def draw_repair(ax, images, layouts: Layouts, repair: Repair) -> None:
    """One scene with the path after some of the steps."""
    draw_scene(ax, images[repair.scene])
    draw_footprints(ax, layouts, repair.scene)
    steps = np.linspace(0, len(repair.z) - 1, DRAWN).round().astype(int)
    for i, step in enumerate(steps):
        shade = to_hex(colormaps[SHADES](0.02 + 0.78 * i / (len(steps) - 1)))
        edge = i in (0, len(steps) - 1)
        draw_path(ax, repair.z[step], shade, width=1.9 if edge else 0.9, halo=edge)


def _outcome(repair: Repair) -> str:
    """What came of it, by the truth and by the model."""
    if repair.valid:
        return "ends valid" if repair.accepted else "ends valid, model unsure"
    return "ends invalid, model fooled" if repair.accepted else "ends invalid, model says so"
