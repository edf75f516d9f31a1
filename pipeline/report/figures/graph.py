"""The causal graph that every question is asked of."""

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch

from pipeline.report.style import INK, MUTED, PAPER

PLACES = {"O": (0, 1), "I": (1.3, 1), "Z_I": (2.6, 1), "S": (2.6, 2), "Z_theta": (2.6, -0.2), "V": (3.9, 1)}
NAMES = {"Z_I": r"$Z_I$", "Z_theta": r"$Z_\theta$"}
SAID = {
    "O": "items on\nthe table", "I": "picture", "Z_I": "what a model\nkeeps of it", "S": "user", "Z_theta": "path",
    "V": "valid?",
}  # fmt: skip
RADIUS = 0.24


def draw(parents: Mapping[str, Sequence[str]]) -> Figure:
    """Nodes at fixed places, an arrow from every parent; small circles are the noises of nodes not determined."""
    figure = Figure((5.6, 2.9), layout="constrained")
    ax = figure.subplots()
    for node, causes in parents.items():
        x, y = PLACES[node]
        ax.add_patch(Circle((x, y), RADIUS, facecolor=PAPER, edgecolor=INK, lw=1.2, zorder=3))
        ax.text(x, y, NAMES.get(node, node), ha="center", va="center", fontsize=11, zorder=4)
        ax.text(x, y - RADIUS - 0.08, SAID[node], ha="center", va="top", fontsize=7.5, color=MUTED, zorder=4)
        for cause in causes:
            _arrow(ax, PLACES[cause], (x, y), RADIUS, RADIUS, INK)
        if node != "Z_I":  # its parent determines it
            noise = (x - 0.6, y) if node == "Z_theta" else (x + 0.42, y + 0.42)
            ax.add_patch(Circle(noise, 0.09, facecolor=PAPER, edgecolor=MUTED, lw=0.9, zorder=3))
            _arrow(ax, noise, (x, y), 0.09, RADIUS, MUTED)
    ax.set(xlim=(-0.5, 4.6), ylim=(-0.85, 2.7), aspect="equal")
    ax.axis("off")
    return figure


def _arrow(ax, start: tuple, end: tuple, from_radius: float, to_radius: float, shade: str) -> None:
    """From rim to rim."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    length = (dx**2 + dy**2) ** 0.5
    a = (start[0] + dx / length * from_radius, start[1] + dy / length * from_radius)
    b = (end[0] - dx / length * to_radius, end[1] - dy / length * to_radius)
    ax.add_patch(FancyArrowPatch(a, b, arrowstyle="-|>", mutation_scale=9, shrinkA=0, shrinkB=0, color=shade, lw=1.0))
