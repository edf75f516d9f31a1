"""What the overview draws: the paper's curve, one scene with repairs, and the widget's data for the browser."""

import base64
from collections.abc import Sequence
from typing import Any

import cv2
import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt

from pipeline.report import style
from pipeline.report.drawing import draw_map, draw_table, fewer_levels, panels
from pipeline.report.pages.repair import draw_repairs, first_start, trace
from pipeline.report.results import Results, paper_accuracy
from pipeline.world.bezier import P_F, P_INIT, Z_HIGH, Z_LOW, lattice

ANYWHERE = [0.43, 0.91]  # a control point on the table [m]
LEAST_DIFFERENCE = 0.05  # smallest share of a map's cells in which two users differ


def curve(results: Results) -> pd.DataFrame:
    """Return accuracy by demonstrations: each reading on held-out paths beside the paper's, the first on new tables."""
    table, first = results.table("curve").query("users == 'paper'"), results.readings[0]
    parts = []
    for reading in results.readings:
        held_out = table[(table["split"] == "held_out") & (table["reading"] == reading)]
        rows = pd.concat([held_out, paper_accuracy()], ignore_index=True)
        parts.append(rows.assign(place=f"Training tables, {style.label(reading)}"))
    new = table[(table["split"] == "new_scenes") & (table["reading"] == first)]
    return pd.concat([*parts, new.assign(place=f"New tables, {style.label(first)}")], ignore_index=True)


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


def widget(results: Results) -> dict[str, Any]:
    """Return the widget's data, ready for JSON.

    `maps` is one grey image, P(valid) from 0 to 255: below one another for each table, user and source in turn, each
    (side, side) with row 0 at `low`.
    """
    drawn, users = results.drawn, results.judged_users
    models = [v for v in ("full", "clearance") if v in results.shown] or results.shown[:1]
    shown, maps = [], []
    for top, images, by_variant in (
        ("", drawn.images, drawn.maps),
        ("patterned", drawn.patterned, drawn.patterned_maps),
    ):
        for place, scene in enumerate(drawn.mapped):
            image = images[place if top else scene]
            shown.append(_png(fewer_levels(image)[..., ::-1]))
            for user in users:
                maps += [drawn.truth[user][place], *(by_variant[v][user][place] for v in models)]
    stacked = np.rint(255 * np.concatenate(maps).astype(float)).astype(np.uint8)
    return {
        "start": P_INIT.tolist(),
        "end": P_F.tolist(),
        "low": Z_LOW,
        "high": Z_HIGH,
        "side": stacked.shape[1],
        "users": users,
        "first": _first_control_point(drawn.truth[users[0]][0], [drawn.maps[v][users[0]][0] for v in models]),
        "sources": ["Truth", *map(style.label, models)],
        "scenes": drawn.mapped,
        "images": shown,  # of each scene on its own table top, then on the patterned one
        "maps": _png(stacked),
        "palette": [to_hex(colour) for colour in matplotlib.colormaps[style.MAP](np.linspace(0, 1, 9))],
    }


def _first_control_point(truth: Array, maps: Sequence[Array]) -> list[float]:
    """Return a control point [m] on the table where models differ: the last one is right, the first one wrong.

    It lies deepest inside such a region; without one it is `ANYWHERE`.
    """
    z, last, first = lattice(len(truth)), maps[-1] > 0.5, maps[0] > 0.5
    on_table = ((z > 0) & (z < 1)).all(-1).reshape(truth.shape)
    differ = np.pad(on_table & (last == truth) & (first != truth), 1)
    depth = distance_transform_edt(differ)[1:-1, 1:-1]
    return z[int(depth.argmax())].tolist() if depth.any() else ANYWHERE


def _png(pixels: Array) -> str:
    """Return grey or BGR pixels as the data URI of a PNG."""
    _, encoded = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    return "data:image/png;base64," + base64.b64encode(encoded.tobytes()).decode()
