"""The overview: the same scene as image, truth and beliefs, with a gradient repair on each."""

import numpy as np
from matplotlib.figure import Figure
from numpy import ndarray as Array

from pipeline.report import style
from pipeline.report.drawing import draw_map, draw_path, draw_table, panels
from pipeline.report.results import Results


def overview(results: Results) -> Figure:
    """Draw a row a user: image with a repair by each shown model, true map, and each model's map with the trace."""
    shown = [v for v in ("full", "clearance") if v in results.shown] or results.shown[:1]
    rows = [(user, *found) for user in results.repaired_users if (found := first_start(results, user)) is not None]
    figure, axes = panels(max(len(rows), 1), 2 + len(shown), 3.0 * (2 + len(shown)), 3.15 * max(len(rows), 1))
    for line, (user, scene, start) in zip(axes, rows, strict=False):
        drawn, place = results.drawn, results.drawn.mapped.index(scene)
        draw_table(line[0], drawn.images[scene], drawn.layouts, scene, results.users[user])
        traces = {v: trace(results, v, user, scene, start) for v in shown}
        draw_path(line[0], traces[shown[0]][0], style.INVALID, linestyle=(0, (3, 1.5)))  # pyright: ignore
        for variant, steps in traces.items():
            draw_path(line[0], steps[-1], style.colour(variant))
        draw_map(line[1], drawn.truth[user][place])
        for cell, variant in zip(line[2:], shown, strict=True):
            draw_map(cell, drawn.maps[variant][user][place], traces[variant])
        line[0].set_ylabel(f"{user} user", color=style.INK, fontsize=12)
    titles = ["Table, start (orange), repairs", "Truth", *map(style.label, shown)]
    for cell, title in zip(axes[0], titles, strict=True):
        cell.set_title(title)
    return figure


def first_start(results: Results, user: str) -> tuple[int, int] | None:
    """Return the scene and start of the user's first repair in a mapped scene, chosen by no look at results."""
    rows = results.tables["repairs"]
    rows = rows[(rows["user"] == user) & (rows["method"] == "gradient") & rows["scene"].isin(results.drawn.mapped)]
    if rows.empty:
        return None
    first = rows.sort_values(["scene", "start"]).iloc[0]
    return int(first["scene"]), int(first["start"])


def trace(results: Results, variant: str, user: str, scene: int, start: int) -> Array:
    """Return the control points (step, 2) [m] of the first seed's gradient repair from one start."""
    seed = results.seeds[0]
    rows = results.tables["repairs"]
    rows = rows[(rows["method"] == "gradient") & (rows["variant"] == variant) & (rows["user"] == user)]
    rows = rows[rows["seed"] == seed]
    at = np.flatnonzero((rows["scene"] == scene) & (rows["start"] == start))
    return results.paths[f"{variant}-{user}-s{seed}"][int(at[0])]
