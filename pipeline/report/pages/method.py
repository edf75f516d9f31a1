"""What the page on methods draws: items, training scenes with demonstrations, and the causal model."""

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy import ndarray as Array

from pipeline.report import style
from pipeline.report.drawing import draw_path, draw_table, panels
from pipeline.report.results import Results
from pipeline.world.layout import SYMBOLS

SPLITS = {"train": style.TRAIN, "unseen": style.UNSEEN}
TILE_PX = 56  # side of an item's image in the catalogue figure


def items(results: Results) -> Figure:
    """Draw the catalogue: one row per symbol, training items framed green, unseen ones red."""
    table = results.catalogue.items
    by_symbol = [
        [(s, i) for s in SPLITS for i in np.flatnonzero((table["symbol"] == o) & (table["split"] == s))]
        for o in SYMBOLS
    ]
    columns = max(map(len, by_symbol))
    figure, axes = panels(len(SYMBOLS), columns, 0.78 * columns + 0.9, 0.85 * len(SYMBOLS))
    for line, symbol, row in zip(axes, SYMBOLS, by_symbol, strict=True):
        line[0].set_ylabel(symbol, rotation=0, ha="right", va="center")
        for panel in line:
            panel.set(xticks=[], yticks=[])
            panel.spines[:].set_visible(False)
        for panel, (split, item) in zip(line, row, strict=False):
            panel.imshow(_tile(results.catalogue.cutouts[item]), interpolation="none")
            panel.spines[:].set(visible=True, color=SPLITS[split], linewidth=2.2)
    return figure


def _tile(cutout: Array) -> Array:
    """Return a small version of a cutout (side, side, 4) on light grey."""
    small = cv2.resize(cutout, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA).astype(float)
    alpha = small[..., 3:] / 255
    return (small[..., :3] * alpha + 225 * (1 - alpha)).round().astype(np.uint8)


def demonstrations(results: Results) -> Figure:
    """Draw the first training scenes with each user's demonstrations: valid ones blue, invalid ones orange."""
    users, scenes = results.judged_users, range(len(results.drawn.training))
    figure, axes = panels(len(users), len(scenes), 2.8 * len(scenes), 2.95 * len(users))
    table = results.table("demos")
    table = table[table["seed"] == results.seeds[0]]
    for line, user in zip(axes, users, strict=True):
        for panel, scene in zip(line, scenes, strict=True):
            draw_table(panel, results.drawn.training[scene])
            rows = table[(table["user"] == user) & (table["scene"] == scene)]
            for x, y, valid in rows[["z_x", "z_y", "valid"]].itertuples(index=False):
                draw_path(panel, np.array([x, y]), style.VALID if valid else style.INVALID, 1.6)
            panel.set_title(f"{user}, scene {scene}")
    return figure


def graph(results: Results) -> Figure:
    """Draw the paper's structural causal model: items cause the image; image, path and user cause validity."""
    figure, axes = panels(1, 1, 7.2, 3.2)
    panel = axes[0, 0]
    places = {name: (0.2, 2.6 - 2.4 * i / max(len(SYMBOLS) - 1, 1)) for i, name in enumerate(SYMBOLS)}
    places |= {"$Z_I$": (2.2, 1.4), "$Z_\\theta$": (2.9, 2.6), "$S$": (2.9, 0.2), "$V$": (4.4, 1.4)}
    words = {"$Z_I$": "scene", "$Z_\\theta$": "path", "$S$": "user", "$V$": "valid"}
    for name, place in places.items():
        if name in SYMBOLS:
            _arrow(panel, place, places["$Z_I$"], 0.42)
            panel.text(
                *place,
                name,
                ha="center",
                va="center",
                fontsize=11,
                bbox={"boxstyle": "round", "fc": "none", "ec": style.MUTED},
            )
            continue
        if name != "$V$":
            _arrow(panel, place, places["$V$"], 0.32)
        panel.add_patch(Circle(place, 0.3, fill=False, edgecolor=style.INK, linewidth=1.4))
        panel.text(*place, name, ha="center", va="center", fontsize=13)
        panel.text(place[0] + 0.4, place[1] + 0.02, words[name], ha="left", va="bottom", fontsize=10, color=style.MUTED)
    panel.set(xlim=(-0.5, 5.3), ylim=(-0.3, 3.1), aspect="equal")
    panel.axis("off")
    return figure


def _arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], gap: float) -> None:
    options = {"arrowstyle": "-|>", "color": style.MUTED, "shrinkA": 72 * gap, "shrinkB": 72 * 0.32, "linewidth": 1.2}
    axes.annotate("", end, start, arrowprops=options)
