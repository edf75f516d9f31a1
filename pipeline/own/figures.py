"""Figures and tables of the page of one's own table that are more than columns of its results.

Names that people chose stand in captions, which every browser can write. In a figure they stand only where its font has
the letters.
"""

import itertools

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon, Rectangle
from numpy import ndarray as Array

from pipeline.causal.experiment import DISTANCES_M
from pipeline.own.folder import Folder
from pipeline.own.frame import Frame, outline
from pipeline.own.results import Results
from pipeline.report import style
from pipeline.report.drawing import draw_table, panels
from pipeline.world.bezier import bezier
from pipeline.world.layout import SIDE

FIRST_SCENES, SHEET_COLUMNS = 12, 6  # of the contact sheet
DRAWN_REPAIRS = 4  # for each user
PHOTOGRAPH_PX = 240  # side of a photograph on which paths are drawn
AROUND = 0.05  # what panels with paths show beside the table [m of the model]
LISTED_SCENES = 5  # for each user; the csv file holds all


def recall(results: Results) -> pd.DataFrame:
    """Return the number of listed items and the share that was detected, by kind and over all."""
    detected = results.tables["detections"]
    rows = detected.groupby("kind")["detected"].agg(items="size", recall="mean").reset_index()
    rows.loc[len(rows)] = ["all", len(detected), detected["detected"].mean()]
    return rows


def next_scenes(results: Results) -> pd.DataFrame:
    """Return the scenes about which each user's models disagree most."""
    return results.tables["disagreement"].groupby("user", sort=False).head(LISTED_SCENES)


def distances(results: Results) -> pd.DataFrame:
    """Return what share of paths each user accepts by kind and clearance of an item; clearance: in words."""
    table = results.tables["asked_distances"].sort_values(["user", "from_m", "kind"])
    words = {m: f"{100 * m:.0f} to {100 * end:.0f} cm" for m, end in itertools.pairwise(DISTANCES_M)}
    words[DISTANCES_M[-1]] = f"from {100 * DISTANCES_M[-1]:.0f} cm"
    return table.assign(clearance=table["from_m"].map(words))


def _draw(panel: Axes, image: Array, frame: Frame, around: float = 0) -> None:
    """Draw a table, without what continues the picture to the model's square."""
    draw_table(panel, image)
    width, depth = frame.to_model(np.array(frame.size_m))
    panel.images[0].set_clip_path(Rectangle((0, 0), width, depth, transform=panel.transData))
    panel.set(xlim=(-around, width + around), ylim=(-around, depth + around))


def _draw_numbered(panel: Axes, number: int, image: Array, frame: Frame, outlines: list[Array]) -> None:
    """Draw a table with white outlines under its number."""
    _draw(panel, image, frame)
    panel.set_title(str(number))
    for points in outlines:
        panel.add_patch(Polygon(points, fill=False, edgecolor="white", linewidth=1.2))


def sheet(results: Results) -> Figure:
    """Draw the first scenes with the outlines of what models see in them."""
    return draw_scenes(results.folder, FIRST_SCENES)


def draw_scenes(folder: Folder, most: int) -> Figure:
    """Draw the first scenes of a folder, at most so many, with the outlines of what models see in them."""
    shown = min(most, len(folder.scenes))
    columns, rows = min(SHEET_COLUMNS, shown), -(-shown // SHEET_COLUMNS)
    figure, axes = panels(rows, columns, 2.1 * columns, 2.35 * rows)
    for number, panel in enumerate(axes.flat):
        if number < shown:
            _draw_numbered(panel, number + 1, folder.images[number], folder.frame, folder.outlines(number))
        else:
            panel.set_axis_off()
    return figure


def empty_table(results: Results) -> Figure:
    """Draw the empty table that the pictures give, with what the detector finds on it, and where they disagree."""
    folder, stack = results.folder, results.folder.from_pictures
    assert stack is not None  # the page asks
    figure, axes = panels(1, 2, 4.8, 2.6)
    rings = [outline(one.ends, np.float64(one.radius)) for one in folder.standing]
    _draw_numbered(axes[0, 0], 1, folder.frame.image(stack.canvas), folder.frame, rings)
    unsure = np.repeat(255 * stack.unsure[..., None].astype(np.uint8), 3, axis=-1)
    _draw_numbered(axes[0, 1], 2, folder.frame.image(unsure), folder.frame, [])
    return figure


def repairs(results: Results) -> Figure:
    """Draw the first repairs of each user: the demonstration's path and the nearest path that the model accepts."""
    first = results.tables["repaired"].dropna().groupby(["user", "scene"]).head(1)  # of each scene
    drawn = {user: first[first["user"] == user].head(DRAWN_REPAIRS) for user in first["user"].unique()}
    width = max(map(len, drawn.values()))
    figure, axes = panels(len(drawn), width, 2.7 * width, 2.95 * len(drawn))
    for line, (user, rows) in zip(axes, drawn.items(), strict=True):
        for panel in line[len(rows) :]:
            panel.set_axis_off()
        for number, (panel, row) in enumerate(zip(line, rows.itertuples(), strict=False)):
            demos, frame = results.folder.demos, results.folder.frame
            _draw(panel, frame.image(results.folder.canvases[row.scene], PHOTOGRAPH_PX), frame, AROUND)
            demo = demos[(demos["user"] == user) & (demos["scene"] == row.scene) & (demos["demo"] == row.demo)]
            end = frame.to_model(results.repaired_paths(user, row.scene)[row.demo])
            start = bezier(results.folder.controls(demo)[0], len(end))
            panel.plot(*start.T, "--", color=style.START, linewidth=2)
            panel.plot(*end.T, color=style.VALID, linewidth=2)
            panel.set_title(f"{results.title(user)}, {number + 1}: {row.p_before:.2f} to {row.p_after:.2f}")
    return figure


def additions(results: Results) -> Figure:
    """Draw one place of each kind that was composited."""
    figure, axes = panels(1, len(results.added), 2.4 * len(results.added), 2.6)
    for number, (panel, places) in enumerate(zip(axes[0], results.added.values(), strict=True), 1):
        around = outline(places.footprint.ends[0, 0], places.footprint.radius[0, 0] + 2 / SIDE)
        _draw_numbered(panel, number, places.image, results.folder.frame, [around])
    return figure
