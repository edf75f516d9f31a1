"""Figures of the page of one's own table; the template names these functions.

Names that people chose stand in captions, which every browser can write. In a figure they stand only where its font has
the letters.
"""

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.patches import Polygon
from numpy import ndarray as Array

from pipeline.own.fitting import VARIANT
from pipeline.own.results import Results
from pipeline.report import style
from pipeline.report.drawing import draw_path, draw_table, panels
from pipeline.world.layout import SIDE

SHEET = 6, 2  # columns and rows of the contact sheet
DRAWN_REPAIRS = 4  # for each user
PHOTOGRAPH_PX = 240  # side of a photograph on which paths are drawn
CIRCLE = np.linspace(0, 2 * np.pi, 48)


def title(results: Results, user: str) -> str:
    """Return a user's name for a figure, or its number where the font lacks a letter."""
    with matplotlib.rc_context(style.RC):
        font = get_font(findfont("DejaVu Sans"))
    known = all(font.get_char_index(ord(letter)) for letter in user)
    return user.replace("\\", "\\\\").replace("$", r"\$") if known else f"user {results.users.index(user) + 1}"


def sheet(results: Results) -> Figure:
    """Draw the first scenes as the models see them, with the outlines of the detected objects."""
    columns, rows = SHEET
    shown = min(columns * rows, len(results.scenes.names))
    columns = min(columns, shown)
    figure, axes = panels(-(-shown // columns), columns, 2.1 * columns, 2.35 * -(-shown // columns))
    for number, panel in enumerate(axes.flat):
        if number >= shown:
            panel.set_axis_off()
            continue
        draw_table(panel, results.scenes.images[number])
        panel.set_title(str(number + 1))
        objects = results.scenes.objects
        for ends, radius in zip(objects.ends[number], objects.radius[number], strict=True):
            if radius > 0:
                panel.add_patch(Polygon(outline(ends, radius), fill=False, edgecolor="white", linewidth=1.2))
    return figure


def outline(ends: Array, radius: float | np.floating) -> Array:
    """Return the outline (point, 2) of a capsule [m]."""
    along = ends[1] - ends[0]
    round_ = radius * np.stack([np.cos(CIRCLE), np.sin(CIRCLE)], -1)
    return np.where((round_ @ along > 0)[:, None], ends[1], ends[0]) + round_


def reliability(results: Results) -> Figure:
    """Draw the share of valid demonstrations against P(valid), a panel for each user; areas show the numbers."""
    figure, axes = panels(1, len(results.users), 3.6 * len(results.users) + 0.4, 3.7, sharey=True)
    for panel, user in zip(axes[0], results.users, strict=True):
        rows = results.calibration.query("user == @user and predictor == @VARIANT and count > 0")
        panel.plot([0, 1], [0, 1], color=style.MUTED, linestyle="--", linewidth=1)
        panel.scatter(
            rows["confidence"], rows["frequency"], s=6 * rows["count"], color=style.colour(VARIANT), edgecolor=style.INK
        )
        for row in rows.itertuples():
            panel.annotate(str(row.count), (row.confidence, row.frequency), (9, -11), textcoords="offset points")
        panel.set(title=title(results, user), xlim=(-0.06, 1.1), ylim=(-0.08, 1.1), xlabel="P(valid) of the model")
        panel.grid()
    axes[0, 0].set_ylabel("share valid by the user’s word")
    return figure


def learning(results: Results) -> Figure:
    """Draw accuracy against the number of scenes that models were fitted to, a panel for each user."""
    figure, axes = panels(1, len(results.users), 3.6 * len(results.users) + 0.4, 3.4, sharey=True)
    for panel, user in zip(axes[0], results.users, strict=True):
        rows = results.scores.query("user == @user and predictor == @VARIANT").sort_values("share")
        training = len(results.fitted[user].data.scenes) * (1 - 1 / len(results.fitted[user].fold_models))
        x, colour = rows["share"] * training, style.colour(VARIANT)
        panel.fill_between(x, 100 * rows["ci_low"], 100 * rows["ci_high"], color=colour, alpha=0.15)
        panel.plot(x, 100 * rows["accuracy"], marker="o", color=colour, linewidth=2)
        blind = results.scores.query("user == @user and predictor == 'position_only'")["accuracy"].iloc[0]
        panel.axhline(100 * blind, color=style.MUTED, linestyle="--", linewidth=1)
        panel.set(title=title(results, user), xlabel="scenes fitted to", xlim=(0, None))
        panel.grid(axis="y")
    axes[0, 0].set(ylabel="accuracy, per cent", ylim=(None, 101))
    return figure


def repairs(results: Results) -> Figure:
    """Draw the first repairs of each user: the demonstration's path and the nearest path that the model accepts."""
    first = results.repairs.dropna().groupby(["user", "scene"]).head(1)  # of each scene
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
    for number, (panel, places) in enumerate(zip(axes[0], results.added.values(), strict=True)):
        draw_table(panel, places.images_with[0])
        panel.add_patch(
            Polygon(
                outline(places.footprint.ends[0, 0], places.footprint.radius[0, 0] + 2 / SIDE),
                fill=False,
                edgecolor="white",
            )
        )
        panel.set_title(str(number + 1))
    return figure
