"""What the page on repairs draws: examples of repairs, failures among them, and success rates."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray as Array

from pipeline.report import style
from pipeline.report.drawing import draw_path, draw_table, panels
from pipeline.report.results import PAPER_TABLE_1, Results
from pipeline.world.bezier import curve
from pipeline.world.rules import valid

MIDDLE = 40  # of 81 points along a path: where its mark stands
BASELINES = ("random_path", "constant_detour", "oracle")


def by_model(results: Results) -> pd.DataFrame:
    """Return the results of repairs by method, model and user; a baseline is its own model."""
    table = results.table("repair")
    return table.assign(variant=table["variant"].where(table["variant"] != "", table["method"]))


def success(results: Results) -> pd.DataFrame:
    """Return success of gradient repair by model and user, of one detour for all, and the paper's rate."""
    table = by_model(results)
    paper = [
        {"variant": "paper", "user": u, "success": PAPER_TABLE_1[u]}
        for u in table["user"].unique()
        if u in PAPER_TABLE_1
    ]
    rows = table[(table["method"] == "gradient") | (table["variant"] == "constant_detour")]
    return pd.concat([rows, pd.DataFrame(paper * ("full" in results.variants))], ignore_index=True)


def drawn(results: Results) -> Figure:
    """Draw the first repair in each mapped scene, one row per user: the start, and each shown model's end.

    An end that is truly invalid has a cross.
    """
    users, scenes = results.repaired_users, results.drawn.mapped
    figure, axes = panels(len(users), len(scenes), 3.9 * len(scenes), 4.0 * len(users))
    for line, user in zip(axes, users, strict=True):
        for panel, scene in zip(line, scenes, strict=True):
            draw_table(panel, results.drawn.images[scene], results.drawn.layouts, scene, results.users[user])
            panel.set_title(f"{user} user, scene {scene}")
            start = first_start(results, user, scene)
            if start is None:
                panel.set_xlabel("no invalid path")
                continue
            traces = {v: trace(results, v, user, scene, start) for v in results.shown}
            draw_repairs(panel, traces)
            for steps in traces.values():
                if not valid(results.drawn.layouts[[scene]], steps[None, -1:], results.users[user])[0, 0]:
                    panel.plot(
                        *curve(steps[-1], 81)[MIDDLE], "X", color="white", markersize=11, markeredgecolor="black"
                    )
    handles = [Line2D([], [], color=style.START, linewidth=3, linestyle="--", label="start")]
    handles += [Line2D([], [], color=style.colour(v), linewidth=3, label=style.label(v)) for v in results.shown]
    cross = {"linestyle": "", "markersize": 11, "markeredgecolor": "black", "label": "ends invalid"}
    handles.append(Line2D([], [], marker="X", color="white", **cross))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return figure


def draw_repairs(axes: Axes, traces: Mapping[str, Array | None]) -> None:
    """Draw the starts of repairs (yellow, dashed) and each variant's end."""
    steps = {variant: trace for variant, trace in traces.items() if trace is not None}
    for variant, points in steps.items():
        draw_path(axes, points[-1], style.colour(variant))
    if steps:
        draw_path(axes, next(iter(steps.values()))[0], style.START, linestyle=(0, (3, 1.5)))


def first_start(results: Results, user: str, scene: int) -> int | None:
    """Return the number of the user's first invalid path in a scene, regardless of its repair."""
    rows = results.table("repairs")
    rows = rows[(rows["user"] == user) & (rows["method"] == "gradient") & (rows["scene"] == scene)]
    return None if rows.empty else int(rows["start"].min())


def trace(results: Results, variant: str, user: str, scene: int, start: int) -> Array:
    """Return the control points (step, 2) [m] of the first seed's gradient repair from one start."""
    seed = results.seeds[0]
    rows = results.table("repairs")
    rows = rows[(rows["method"] == "gradient") & (rows["variant"] == variant) & (rows["user"] == user)]
    rows = rows[rows["seed"] == seed]
    at = np.flatnonzero((rows["scene"] == scene) & (rows["start"] == start))
    return results.paths[f"{variant}-{user}-s{seed}"][int(at[0])]
