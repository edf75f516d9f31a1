"""The simulated world: its P(valid) beside the paper's, and scenes with what users demonstrated there."""

from jaxtyping import Bool, Float, UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import DASHES, draw_demonstration, draw_scene
from pipeline.report.style import INK, INVALID, MUTED, VALID
from pipeline.table.layout import SYMBOLS

TOLERANCE = 0.03  # how near to the paper's number each true one is meant to be


def draw_calibration(p_valid: dict[str, dict[str, dict]], users: list[str]) -> Figure:
    """One row per user and intervention: the paper's number and the world's true one."""
    cells = [(u, s, p_valid[u][s]) for u in users for s in ("none", *SYMBOLS)]
    figure = Figure((4.2, 0.2 * len(cells) + 0.95), layout="constrained")
    ax = figure.subplots()
    for y, (_, _, cell) in enumerate(cells):
        if cell.get("paper") is not None:
            ax.plot([cell["paper"] - TOLERANCE, cell["paper"] + TOLERANCE], [y, y], color=MUTED, lw=5, alpha=0.3)
            ax.plot(cell["paper"], y, "*", color=INK, ms=8, mew=0, zorder=3)
        ax.plot(cell["truth"], y, "o", color=VALID, ms=4.5, mew=0, zorder=4)
    names = [f"{u}: " + ("as it is" if s == "none" else f"+ {s}") for u, s, _ in cells]
    ax.set_yticks(range(len(cells)), names)
    ax.set(xlim=(0, 1.04), ylim=(len(cells) - 0.4, -0.6), xlabel="share of random paths that are valid")
    ax.grid(axis="x")
    handles = [
        Line2D([], [], marker="*", color=INK, ls="", ms=8, mew=0),
        Line2D([], [], color=MUTED, lw=5, alpha=0.3),
        Line2D([], [], marker="o", color=VALID, ls="", ms=4.5, mew=0),
    ]
    labels = ["paper's Table 2", f"± {TOLERANCE:.2f}", "simulated world"]
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


def draw_demonstrations(
    images: UInt8[Array, "scene 100 100 3"],
    demos: dict[str, tuple[Float[Array, "scene n 2"], Bool[Array, "scene n"]]],
) -> Figure:
    """Rows: scenes; columns: users; every demonstration, valid ones whole, invalid ones broken lines."""
    users, rows = list(demos), len(images)
    figure = Figure((1.75 * len(users), 1.75 * rows + 0.55), layout="constrained")
    axes = figure.subplots(rows, len(users), squeeze=False)
    for column, user in enumerate(users):
        z, valid = demos[user]
        for row in range(rows):
            draw_scene(axes[row, column], images[row])
            for path, label in zip(z[row], valid[row], strict=True):
                draw_demonstration(axes[row, column], path, bool(label))
        axes[0, column].set_title(user.capitalize())
    handles = [Line2D([], [], color=VALID, lw=1.5), Line2D([], [], color=INVALID, lw=1.5, ls=DASHES)]
    figure.legend(handles, ["valid", "invalid"], loc="outside lower center", ncols=2, handlelength=3)
    return figure
