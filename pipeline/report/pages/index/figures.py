"""The overview: one scene with the truth and the models' maps, and a gradient repair on each."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray as Array

from pipeline.report import style
from pipeline.report.drawing import draw_band, draw_map, draw_path, draw_table, legend_below, panels
from pipeline.report.results import PAPER_ACCURACY, Results

CURVE_LINES = {"nearest_demonstration": "--", "position_only": ":"}
LEAST_DIFFERENCE = 0.05  # smallest share of a map's cells in which two users differ


def curve(results: Results) -> Figure:
    """Draw accuracy against demonstrations: each reading on held-out paths, and the first one on new tables."""
    places = [("held_out", reading) for reading in results.readings] + [("new_scenes", results.readings[0])]
    figure, axes = panels(1, len(places), 3.3 * len(places), 4.2, sharey=True)
    for panel, (split, reading) in zip(axes[0], places, strict=True):
        table = results.tables["curve"]
        table = table[(table["split"] == split) & (table["reading"] == reading) & (table["users"] == "paper")]
        for name, rows in table.groupby("variant", sort=False):
            rows, line = rows.sort_values("n_demos"), CURVE_LINES.get(str(name), "-")
            low, high = 100 * rows["q1"], 100 * rows["q3"]
            mark = {"linestyle": line, "marker": style.marker(str(name)), "markersize": 4}
            draw_band(panel, rows["n_demos"], 100 * rows["mean"], low, high, str(name), **mark)
        for n, (mean, low, high) in PAPER_ACCURACY.items() if split == "held_out" else ():
            error = [[100 * (mean - low)], [100 * (high - mean)]]
            named = {"label": style.label("paper")} if n == 1 else {}
            panel.errorbar(n, 100 * mean, yerr=error, fmt="*", color=style.INK, markersize=12, capsize=4, **named)
        where = "Training tables" if split == "held_out" else "New tables"
        panel.set(
            title=f"{where}, {style.label(reading)}",
            xlabel="demonstrations a scene",
            xticks=sorted({*table["n_demos"]}),
        )
        panel.grid(axis="y")
    axes[0, 0].set(ylabel="paths judged right, per cent", ylim=(None, 102))
    legend_below(figure, axes[0, 0], 4)
    return figure


def overview(results: Results) -> Figure:
    """Draw one row per user: the image with repairs, true map, each model's map, and the last one on a patterned top.

    Titles give the share of a map that a model has right.
    """
    shown = [v for v in ("full", "clearance") if v in results.shown] or results.shown[:1]
    drawn, users, place = results.drawn, results.repaired_users, _place(results)
    scene, top = drawn.mapped[place], results.facts["patterned_top"]
    columns = 4 + len(shown)
    figure, axes = panels(len(users), columns, 2.15 * columns, 2.5 * len(users))
    for line, user in zip(axes, users, strict=True):
        start, truth = first_start(results, user, scene), drawn.truth[user][place]
        traces = {v: None if start is None else trace(results, v, user, scene, start) for v in shown}
        draw_table(line[0], drawn.images[scene], drawn.layouts, scene, results.users[user])
        draw_repairs(line[0], traces)
        draw_map(line[1], truth)
        line[0].set(title="Bad path, repairs", ylabel=f"{user} user")
        line[1].set_title("Truth")
        for panel, variant in zip(line[2:], shown, strict=False):
            _judged_map(panel, drawn.maps[variant][user][place], truth, style.label(variant), traces[variant])
        draw_table(line[-2], drawn.patterned[place])
        line[-2].set_title(f"The same on {top}")
        _judged_map(line[-1], drawn.patterned_maps[shown[-1]][user][place], truth, style.label(shown[-1]))
    return figure


def _judged_map(axes: Axes, p: Array, truth: Array, name: str, steps: Array | None = None) -> None:
    """Draw a model's map, with the share of control points that it judges correctly in the title."""
    draw_map(axes, p, steps)
    axes.set_title(f"{name}: {np.mean((p > 0.5) == truth):.0%}")


def _place(results: Results) -> int:
    """Return the first mapped scene in which the users' true maps differ; the first scene if there is none."""
    truths = [results.drawn.truth[user] for user in results.repaired_users]
    differ = np.mean(truths[0] != truths[-1], axis=(1, 2)) > LEAST_DIFFERENCE
    return int(differ.argmax())


def draw_repairs(axes: Axes, traces: Mapping[str, Array | None]) -> None:
    """Draw the starts of repairs (yellow, dashed) and each variant's end."""
    steps = {variant: trace for variant, trace in traces.items() if trace is not None}
    for variant, points in steps.items():
        draw_path(axes, points[-1], style.colour(variant))
    if steps:
        draw_path(axes, next(iter(steps.values()))[0], style.START, linestyle=(0, (3, 1.5)))


def first_start(results: Results, user: str, scene: int) -> int | None:
    """Return the number of the user's first invalid path in a scene, regardless of its repair."""
    rows = results.tables["repairs"]
    rows = rows[(rows["user"] == user) & (rows["method"] == "gradient") & (rows["scene"] == scene)]
    return None if rows.empty else int(rows["start"].min())


def trace(results: Results, variant: str, user: str, scene: int, start: int) -> Array:
    """Return the control points (step, 2) [m] of the first seed's gradient repair from one start."""
    seed = results.seeds[0]
    rows = results.tables["repairs"]
    rows = rows[(rows["method"] == "gradient") & (rows["variant"] == variant) & (rows["user"] == user)]
    rows = rows[rows["seed"] == seed]
    at = np.flatnonzero((rows["scene"] == scene) & (rows["start"] == start))
    return results.paths[f"{variant}-{user}-s{seed}"][int(at[0])]
