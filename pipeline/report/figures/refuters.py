"""What should be nothing: effects under every refuter, and what a placebo looks like."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import UInt8
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray as Array

from pipeline.report.figures.tabletop import draw_scene, row_label
from pipeline.report.style import MUTED, PAPER, colour
from pipeline.report.wording import refuter_label, variant_label
from pipeline.table.layout import SYMBOLS

USERS = ("o", "^", "s")  # markers, by user
SPREAD = 0.56  # of a refuter's cells, from the first to the last


def draw(
    refuters: Mapping[str, Mapping[str, dict]], variants: list[str], users: list[str], smallest: float, columns: int
) -> Figure:
    """A panel per variant, a row per refuter: every cell's effect with its 95 % interval; filled: verdict "effect".

    refuters: refuter -> variant -> user -> symbol -> numbers.
    """
    rows = -(-len(variants) // columns)
    figure = Figure((2.2 * columns + 1.2, (2.5 if columns > 1 else 2.2) * rows + 0.6), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False).ravel()
    for ax, variant in zip(axes, variants, strict=False):
        ax.axvspan(-smallest, smallest, color=MUTED, alpha=0.15, lw=0)
        ax.axvline(0, color=MUTED, lw=0.6)
        for y, by_variant in enumerate(refuters.values()):
            if variant not in by_variant:
                continue
            cells = [(i, by_variant[variant][u][s]) for i, u in enumerate(users) for s in SYMBOLS]
            for at, (user, c) in zip(y + np.linspace(-SPREAD / 2, SPREAD / 2, len(cells)), cells, strict=True):
                face = colour(variant) if c["verdict"] == "effect" else PAPER
                ax.plot([c["ci_low"], c["ci_high"]], [at, at], color=colour(variant), lw=0.8)
                ax.plot(c["effect"], at, USERS[user % 3], ms=3.6, mew=0.9, mec=colour(variant), mfc=face)
        ax.set_title(variant_label(variant), loc="left")
        ax.set_ylim(len(refuters) - 0.4, -0.6)
        ax.set_yticks(range(len(refuters)), [refuter_label(name) for name in refuters])
        ax.tick_params(axis="y", length=0)
        ax.set_xlabel("effect, where there is none")
    for ax in axes[len(variants) :]:
        ax.set_visible(False)
    marks = [Line2D([], [], ls="", marker=m, mfc=PAPER, mec=MUTED, ms=4.5) for m in USERS[: len(users)]]
    filled = Line2D([], [], ls="", marker="o", color=MUTED, ms=4.5)
    texts = [*(f"{user} user" for user in users), "filled: verdict “effect”"]
    figure.legend([*marks, filled], texts, loc="outside lower center", ncols=len(texts) if columns > 1 else 2)
    return figure


def draw_placebos(
    added: UInt8[Array, "symbol 100 100 3"], placebos: Mapping[str, UInt8[Array, "symbol 100 100 3"]]
) -> Figure:
    """One scene with each symbol added, above; its pixels, or pieces, shuffled, below."""
    figure = Figure((5.2, 1.1 * (1 + len(placebos))), layout="constrained")
    axes = figure.subplots(1 + len(placebos), len(SYMBOLS))
    for row, (label, pictures) in zip(axes, {"item": added, **placebos}.items(), strict=True):
        for ax, picture, symbol in zip(row, pictures, SYMBOLS, strict=True):
            draw_scene(ax, picture, ends=False)
            ax.set_title(f"+ {symbol}" if label == "item" else "")
        row_label(row[0], label)
    return figure
