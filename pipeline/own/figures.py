"""Figures of the page of one's own table; the template names these functions.

Names that people chose stand in captions, which every browser can write. In a figure they stand only where its font has
the letters.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.patches import Polygon
from numpy import ndarray as Array

from pipeline.own.fitting import VARIANT
from pipeline.own.frame import outline
from pipeline.own.report import Results
from pipeline.report import style
from pipeline.report.drawing import draw_band, draw_path, draw_table, panels
from pipeline.world.layout import SIDE

FIRST_SCENES, SHEET_COLUMNS = 12, 6  # of the contact sheet
DRAWN_REPAIRS = 4  # for each user
PHOTOGRAPH_PX = 240  # side of a photograph on which paths are drawn


def title(results: Results, user: str) -> str:
    """Return a user's name for a figure, or its number where the font lacks a letter."""
    font = get_font(findfont("DejaVu Sans"))
    known = all(font.get_char_index(ord(letter)) for letter in user)
    return user.replace("\\", "\\\\").replace("$", r"\$") if known else f"user {list(results.fitted).index(user) + 1}"


def _panels_by_user(results: Results, height: float, ylabel: str) -> tuple[Figure, dict[str, Axes]]:
    """Return a figure with a panel for each user, under the user's name."""
    count = len(results.fitted)
    figure, axes = panels(1, count, 3.6 * count + 0.4, height, sharey=True)
    axes[0, 0].set_ylabel(ylabel)
    by_user = dict(zip(results.fitted, axes[0], strict=True))
    for user, panel in by_user.items():
        panel.set_title(title(results, user))
    return figure, by_user


def _draw_numbered(panel: Axes, number: int, image: Array, outlines: list[Array]) -> None:
    """Draw a table with white outlines under its number."""
    draw_table(panel, image)
    panel.set_title(str(number))
    for points in outlines:
        panel.add_patch(Polygon(points, fill=False, edgecolor="white", linewidth=1.2))


def sheet(results: Results) -> Figure:
    """Draw the first scenes as the models see them, with the outlines of the detected objects."""
    shown = min(FIRST_SCENES, len(results.folder.scenes))
    columns, rows = min(SHEET_COLUMNS, shown), -(-shown // SHEET_COLUMNS)
    figure, axes = panels(rows, columns, 2.1 * columns, 2.35 * rows)
    for number, panel in enumerate(axes.flat):
        if number < shown:
            _draw_numbered(panel, number + 1, results.folder.images[number], results.folder.outlines(number))
        else:
            panel.set_axis_off()
    return figure


def reliability(results: Results) -> Figure:
    """Draw the share of valid demonstrations against P(valid), a panel for each user; areas show the numbers."""
    figure, axes = _panels_by_user(results, 3.7, "share valid by the user’s word")
    bins = results.tables["reliability"].query("predictor == @VARIANT and count > 0")
    for user, panel in axes.items():
        rows = bins[bins["user"] == user]
        x, y, count = rows["confidence"], rows["frequency"], rows["count"]
        panel.plot([0, 1], [0, 1], color=style.MUTED, linestyle="--", linewidth=1)
        panel.scatter(x, y, s=6 * count, color=style.colour(VARIANT), edgecolor=style.INK)
        for place in zip(x, y, count, strict=True):
            panel.annotate(str(place[2]), place[:2], (9, -11), textcoords="offset points")
        panel.set(xlim=(-0.06, 1.1), ylim=(-0.08, 1.1), xlabel="P(valid) of the model")
        panel.grid()
    return figure


def learning(results: Results) -> Figure:
    """Draw accuracy against the number of scenes that models were fitted to, a panel for each user."""
    figure, axes = _panels_by_user(results, 3.4, "accuracy, per cent")
    for user, fitted in results.fitted.items():
        panel, scores = axes[user], results.tables["scores"].query("user == @user")
        rows = scores.query("predictor == @VARIANT")
        x = rows["share"] * len(fitted.data.scenes) * (1 - 1 / len(fitted.fold_models))
        draw_band(panel, x, 100 * rows["accuracy"], 100 * rows["ci_low"], 100 * rows["ci_high"], VARIANT, marker="o")
        blind = scores.query("predictor == 'position_only'")["accuracy"].iloc[0]
        panel.axhline(100 * blind, color=style.MUTED, linestyle="--", linewidth=1)
        panel.set(xlabel="scenes fitted to", xlim=(0, None))
        panel.grid(axis="y")
    next(iter(axes.values())).set(ylim=(None, 101))
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
            draw_table(panel, results.folder.frame.image(results.folder.canvases[row.scene], PHOTOGRAPH_PX))
            draw_path(panel, np.array([row.z_x, row.z_y]), style.START, linestyle="--")
            draw_path(panel, np.array([row.end_x, row.end_y]), style.VALID)
            panel.set_title(f"{title(results, user)}, {number + 1}: {row.p_before:.2f} to {row.p_after:.2f}")
    return figure


def additions(results: Results) -> Figure:
    """Draw one place of each kind that was composited."""
    figure, axes = panels(1, len(results.added), 2.4 * len(results.added), 2.6)
    for number, (panel, places) in enumerate(zip(axes[0], results.added.values(), strict=True), 1):
        around = outline(places.footprint.ends[0, 0], places.footprint.radius[0, 0] + 2 / SIDE)
        _draw_numbered(panel, number, places.images_with[0], [around])
    return figure
