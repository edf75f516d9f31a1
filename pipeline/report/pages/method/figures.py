"""The items, seen and unseen, and training scenes with demonstrations."""

import cv2
import numpy as np
from matplotlib.figure import Figure
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
    figure, axes = panels(len(users), len(scenes), 3.4 * len(scenes), 3.5 * len(users))
    table = results.tables["demos"]
    table = table[table["seed"] == results.seeds[0]]
    for line, user in zip(axes, users, strict=True):
        for panel, scene in zip(line, scenes, strict=True):
            draw_table(panel, results.drawn.training[scene])
            rows = table[(table["user"] == user) & (table["scene"] == scene)]
            for x, y, valid in rows[["z_x", "z_y", "valid"]].itertuples(index=False):
                draw_path(panel, np.array([x, y]), style.VALID if valid else style.INVALID, 1.6)
            panel.set_title(f"{user}, scene {scene}")
    return figure
