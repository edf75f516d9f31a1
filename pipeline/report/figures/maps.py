"""Validity over the latent trajectory space: the paper's Figure "types_traj", the truth beside the models."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib.figure import Figure
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import draw_map, draw_scene, row_label


@dataclass(frozen=True)
class Maps:
    """One user's maps: for each scene its picture, the truth, and each model's P(valid) over the lattice."""

    names: list[str]  # of the scenes
    images: UInt8[Array, "scene 100 100 3"]
    truth: Float[Array, "scene side side"]
    models: dict[str, Float[Array, "scene side side"]]  # variant's short label -> maps

    def agreement(self, label: str) -> float:
        """Share of control points where a model's p > .5 equals the truth."""
        return float(np.mean((self.models[label] > 0.5) == (self.truth > 0.5)))


def draw(maps: Maps) -> Figure:
    """Rows: scenes; columns: the scene, the truth, the models."""
    titles = ["Scene", "Truth", *maps.models]
    rows, columns = len(maps.images), len(titles)
    figure = Figure((1.15 * columns + 0.3, 1.2 * rows + 0.55), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for i, row in enumerate(axes):
        draw_scene(row[0], maps.images[i])
        row_label(row[0], maps.names[i])
        for ax, values in zip(row[1:], [maps.truth, *maps.models.values()], strict=True):
            draw_map(ax, values[i])
        if i == 0:
            for ax, title in zip(row, titles, strict=True):
                ax.set_title(title)
    bar = figure.colorbar(
        axes[0, 1].images[0], ax=axes, location="bottom", shrink=0.5, aspect=40, pad=0.02, ticks=[0, 0.5, 1]
    )
    bar.set_label("P(valid) of the path with this control point", fontsize=8)
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    return figure
