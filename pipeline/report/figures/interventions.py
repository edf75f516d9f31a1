"""Effects of added items beside the true ones: the paper's Table 2 as a picture, and what was added."""

from jaxtyping import UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import draw_scene
from pipeline.report.style import INK, MUTED, PAPER, colour, marker
from pipeline.report.wording import variant_label
from pipeline.table.layout import SYMBOLS

STEP = 0.12  # distance between two variants' marks


def draw(cells: dict[str, dict[str, dict[str, dict]]], users: list[str], smallest: float, columns: int) -> Figure:
    """Per user a panel, per symbol a group: each variant's effect with its 95 % interval, the truth a bar.

    cells: variant -> user -> symbol -> numbers. Filled: verdict "effect"; hollow: any other.
    """
    rows = -(-len(users) // columns)
    size = (3.1 * columns, 3.1 * rows + 0.75) if columns > 1 else (4.2, 2.9 * rows + 1.1)
    figure = Figure(size, layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=columns > 1, squeeze=False).ravel()
    for ax, user in zip(axes, users, strict=True):
        forest(ax, {variant: by_user[user] for variant, by_user in cells.items()}, smallest)
        ax.set_title(user.capitalize(), loc="left")
        ax.set_xlabel("change of mean P(valid)")
    figure.legend(*key(list(cells)), loc="outside lower center", ncols=4 if columns > 1 else 2, handlelength=1.8)
    return figure


def forest(ax, cells: dict[str, dict[str, dict]], smallest: float) -> None:
    """One user's effects by symbol and variant."""
    variants = list(cells)
    half = STEP * (len(variants) - 1) / 2
    ax.axvspan(-smallest, smallest, color=MUTED, alpha=0.15, lw=0)
    ax.axvline(0, color=MUTED, lw=0.6)
    for y, symbol in enumerate(SYMBOLS):
        truth = cells[variants[0]][symbol]["truth"]
        ax.plot([truth, truth], [y - half - 0.14, y + half + 0.14], color=INK, lw=2.2, zorder=2)
        for i, variant in enumerate(variants):
            c, at = cells[variant][symbol], y + STEP * i - half
            ax.plot([c["ci_low"], c["ci_high"]], [at, at], color=colour(variant), lw=1.1, zorder=3)
            face = colour(variant) if c["verdict"] == "effect" else PAPER
            ax.plot(
                c["effect"], at, marker(variant), ms=5, mew=1.1, mec=colour(variant), mfc=face, color=face, zorder=4
            )
    ax.set_yticks(range(len(SYMBOLS)), [f"+ {s}" for s in SYMBOLS])
    ax.set_ylim(len(SYMBOLS) - 0.45, -0.55)
    ax.tick_params(axis="y", length=0)


def key(variants: list[str]) -> tuple[list, list[str]]:
    """Legend entries: the truth, the variants, and what filled and hollow mean."""
    handles = [Line2D([], [], color=INK, marker="|", ms=10, mew=2.2, ls="")]
    handles += [Line2D([], [], color=colour(v), marker=marker(v), mfc=colour(v), ms=5, lw=1.1) for v in variants]
    handles.append(Line2D([], [], color=MUTED, marker="o", mfc=PAPER, mec=MUTED, ms=5, ls=""))
    return handles, ["truth", *(variant_label(v) for v in variants), "hollow: no verdict “effect”"]


def draw_added(
    scene: UInt8[Array, "100 100 3"], added: UInt8[Array, "symbol 100 100 3"], texts: list[str], columns: int
) -> Figure:
    """One scene as it is and with one more item of each symbol; `texts` go below."""
    rows = -(-(1 + len(added)) // columns)
    figure = Figure((1.25 * columns, 1.85 * rows), layout="constrained")
    axes = figure.subplots(rows, columns).ravel()
    names = ["as it is", *(f"+ {s}" for s in SYMBOLS)]
    for ax in axes[len(names) :]:
        ax.set_visible(False)
    for ax, image, name, text in zip(axes, [scene, *added], names, texts, strict=False):
        draw_scene(ax, image, ends=False)
        ax.set_title(name)
        ax.set_xlabel(text, fontsize=8)
    return figure
