"""What the page on limits and the model card draw: a patterned table top, the scenes with most errors, slices."""

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy import ndarray as Array

from pipeline.report import style
from pipeline.report.drawing import draw_map, draw_path, draw_table, panels
from pipeline.report.results import Results
from pipeline.report.slices import DISTANCE_LABELS, NOTHING, SLICES

OURS = "clearance"
WORST = 5  # scenes shown, those with most errors
SHARE = 0.3  # least share of the fitted models that are wrong about a drawn path
UNSAFE, REFUSED = "#d55e00", "#f0e442"  # wrong answers: invalid paths accepted, valid paths refused


def failing(results: Results) -> str:
    """Return the variant whose failures are shown: the clearance model, or the first one shown."""
    return OURS if OURS in results.shown else results.shown[0]


def patterned(results: Results) -> Figure:
    """Draw one scene as it is and on the patterned top, with the truth and the model's maps, a row per user."""
    drawn, variant = results.drawn, failing(results)
    place = least_right(results)
    scene, users, top = drawn.mapped[place], list(drawn.truth), results.facts["patterned_top"]
    figure, axes = panels(len(users), 5, 13.0, 2.75 * len(users) + 0.2)
    for line, user in zip(axes, users, strict=True):
        truth = drawn.truth[user][place]
        draw_table(line[0], drawn.images[scene], drawn.layouts, scene, results.users[user])
        draw_map(line[1], truth)
        draw_table(line[3], drawn.patterned[place], drawn.layouts, scene, results.users[user])
        for panel, maps in ((line[2], drawn.maps), (line[4], drawn.patterned_maps)):
            _map_with_share(panel, maps[variant][user][place], truth)
        line[0].set_ylabel(f"{user} user", color=style.INK)
    titles = ["Its own table top", "Truth", style.label(variant), f"The same on {top}", style.label(variant)]
    for panel, title in zip(axes[0], titles, strict=True):
        panel.set_title(title)
    return figure


def least_right(results: Results) -> int:
    """Return the mapped scene in which the model has least of the map right on the patterned top, over users."""
    drawn, variant = results.drawn, failing(results)
    right = [((drawn.patterned_maps[variant][u] > 0.5) == drawn.truth[u]).mean((1, 2)) for u in drawn.truth]
    return int(np.mean(right, axis=0).argmin())


def _map_with_share(axes: Axes, p: Array, truth: Array) -> None:
    draw_map(axes, p)
    axes.set_xlabel(f"{100 * np.mean((p > 0.5) == truth):.0f} % of the map right", color=style.INK)


def worst(results: Results) -> Figure:
    """Draw the scenes with most errors: each wrongly judged path of the user with more errors there."""
    scenes = worst_scenes(results)
    figure, axes = panels(1, len(scenes), 2.9 * len(scenes), 3.8)
    judged = results.table("judged")
    judged = judged[(judged["variant"] == failing(results)) & (judged["split"] == "new_items")]
    for panel, row in zip(axes[0], scenes.to_dict("records"), strict=True):
        mine = judged[(judged["scene"] == row["scene"]) & (judged["user"] == row["user"])]
        draw_table(
            panel, results.drawn.images[row["scene"]], results.drawn.layouts, row["scene"], results.users[row["user"]]
        )
        wrong = mine[(mine["p"] > 0.5) != mine["valid"]]
        counts = wrong.groupby(["query", "z_x", "z_y", "valid"]).size().reset_index(name="models")
        for path in counts[counts["models"] >= SHARE * mine["seed"].nunique()].itertuples():
            draw_path(panel, np.array([path.z_x, path.z_y]), REFUSED if path.valid else UNSAFE, 2.2)
        panel.set(title=f"scene {row['scene']}, {row['table_top']}", xlabel=f"{row['user']} user")
    handles = [
        Line2D([], [], color=UNSAFE, linewidth=3, label="accepted, but invalid"),
        Line2D([], [], color=REFUSED, linewidth=3, label="rejected, but valid"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def worst_scenes(results: Results) -> pd.DataFrame:
    """Return the scenes and users with the lowest accuracy on unseen items, one user a scene.

    Columns scene, user, table_top, items, accuracy, unsafe (share of answers: invalid and accepted), errors (share of
    all errors).
    """
    judged = results.table("judged")
    judged = judged[(judged["variant"] == failing(results)) & (judged["split"] == "new_items")]
    accepted = judged["p"] > 0.5
    judged = judged.assign(right=accepted == judged["valid"], unsafe=accepted & ~judged["valid"])
    groups = judged.groupby(["scene", "user", "table_top", "items"], observed=True)
    rows = groups[["right", "unsafe"]].mean().reset_index().rename(columns={"right": "accuracy"})
    rows["errors"] = groups["right"].agg(lambda right: (~right).sum()).to_numpy() / max((~judged["right"]).sum(), 1)
    return rows.sort_values("accuracy", kind="stable").drop_duplicates("scene").head(WORST)


def unsafe(results: Results) -> pd.DataFrame:
    """Return how often accepted paths are invalid and valid ones refused, in new scenes with unseen items.

    With quartiles over training sets of the first kind; the last row accepts every path.
    """
    judged, rows = results.table("judged").query("split == 'new_items'"), []
    for variant in dict.fromkeys([failing(results), *results.shown]):
        accepted = judged[(judged["variant"] == variant) & (judged["p"] > 0.5)]
        q1, q3 = (1 - accepted.groupby("seed")["valid"].mean()).quantile([0.25, 0.75])
        rates = {column: results.sliced(variant, column) for column in ("unsafe", "refused")}
        rows.append({"variant": variant, "q1": q1, "q3": q3} | rates)
    paths = judged[judged["variant"] == failing(results)]
    rows.append({"variant": "blind", "unsafe": 1 - paths["valid"].mean(), "refused": 0.0})
    return pd.DataFrame(rows)


def slices(results: Results) -> pd.DataFrame:
    """Return scores of the slices of unseen-item paths in the order of SLICES, distances from near to far.

    blind: accuracy of the guess by position; paths: their number.
    """
    table = results.table("slices").query("split == 'new_items' and slice != 'all'")
    blind = table[table["variant"] == "position_only"].set_index(["slice", "value"])["accuracy"]
    table = table[table["variant"] == failing(results)].join(blind.rename("blind"), on=["slice", "value"])
    order = {name: i for i, name in enumerate([*DISTANCE_LABELS, NOTHING])}
    by = table.assign(a=table["slice"].map(list(SLICES).index), b=table["value"].map(lambda value: order.get(value, 0)))
    rows = by.sort_values(["a", "b", "value"])
    return rows.assign(slice=rows["slice"].map(SLICES), paths=rows["count"] / len(results.seeds))
