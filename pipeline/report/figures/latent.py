"""What the paper's model keeps of a scene: reconstructions, and one dimension of z_image moved at a time."""

import numpy as np
from jaxtyping import Int, UInt8
from matplotlib.figure import Figure
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import bare, row_label


def draw_reconstructions(
    images: UInt8[Array, "scene 100 100 3"], decoded: UInt8[Array, "scene 100 100 3"], seen: int
) -> Figure:
    """Scenes above, their reconstructions below; the first `seen` scenes were trained on."""
    count = len(images)
    figure = Figure((0.7 * count + 0.3, 1.8), layout="constrained")
    axes = figure.subplots(2, count, squeeze=False)
    for i in range(count):
        axes[0, i].imshow(images[i], interpolation="none")
        axes[1, i].imshow(decoded[i], interpolation="none")
    for ax in axes.ravel():
        bare(ax)
    for first, group in ((0, "trained on"), (seen, "unseen items")):
        axes[0, first].set_title(group, loc="left", fontsize=8)
    row_label(axes[0, 0], "scene")
    row_label(axes[1, 0], "rebuilt")
    return figure


def liveliest(traversal: UInt8[Array, "latent value 100 100 3"], count: int) -> Int[Array, " count"]:
    """The dimensions that change the picture most, by standard deviation over values; the liveliest first."""
    change = traversal.astype(np.float64).std(axis=1).mean(axis=(1, 2, 3))
    return np.argsort(-change, kind="stable")[:count]


def draw_traversals(
    traversal: UInt8[Array, "latent value 100 100 3"], dimensions: Int[Array, " row"], values: list[float]
) -> Figure:
    """Rows: dimensions of z_image; columns: the value each is set to, the others left alone."""
    figure = Figure((0.8 * len(values) + 0.3, 0.8 * len(dimensions) + 0.3), layout="constrained")
    axes = figure.subplots(len(dimensions), len(values), squeeze=False)
    for row, dimension in zip(axes, dimensions, strict=True):
        for ax, picture in zip(row, traversal[dimension], strict=True):
            ax.imshow(picture, interpolation="none")
            bare(ax)
        row_label(row[0], f"dim. {dimension + 1}")
    for ax, value in zip(axes[0], values, strict=True):
        ax.set_title(f"{value:+g}" if value else "0", fontsize=8)
    return figure
