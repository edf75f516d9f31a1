"""What the page on users draws: who accepts which path, margins, and what each user reacts to."""

import numpy as np
import pandas as pd
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from pipeline.report import slices, style
from pipeline.report.drawing import draw_table, panels
from pipeline.report.results import PAPER_TABLE_2, Results
from pipeline.world.bezier import Z_HIGH, Z_LOW
from pipeline.world.layout import SYMBOLS

KINDS = ListedColormap(["#3b4252", "#d55e00", "#56b4e9", "#f0e442"])  # valid to neither, first only, second only, both
REACTS = ("full", "clearance")
MARGINS = {"user": "User"} | dict(zip(SYMBOLS, SYMBOLS, strict=True)) | {"valid": "Valid", "paper": "Valid, paper"}
MARGIN_FORMATS = dict.fromkeys(SYMBOLS, "cm") | {"Valid": "pct", "Valid, paper": "pct"}


def who_accepts(results: Results) -> Figure:
    """Draw, for the mapped scenes, which control points are valid to both, one or none of two users."""
    drawn, (first, second) = results.drawn, results.pair
    columns = ["truth", *(v for v in results.shown if v in REACTS)]
    figure, axes = panels(len(drawn.mapped), 1 + len(columns), 2.9 * (1 + len(columns)), 2.85 * len(drawn.mapped) + 0.5)
    for place, (line, scene) in enumerate(zip(axes, drawn.mapped, strict=True)):
        draw_table(line[0], drawn.images[scene], drawn.layouts, scene, results.users[first])
        for panel, name in zip(line[1:], columns, strict=True):
            maps = drawn.truth if name == "truth" else drawn.maps[name]
            kind = np.asarray(maps[first][place] > 0.5, int) + 2 * np.asarray(maps[second][place] > 0.5, int)
            extent = (Z_LOW, Z_HIGH, Z_LOW, Z_HIGH)
            panel.imshow(kind, cmap=KINDS, vmin=0, vmax=3, origin="lower", extent=extent, interpolation="none")
            panel.plot([0, 1, 1, 0, 0], [0, 0, 1, 1, 0], color="white", linewidth=0.8, linestyle=(0, (3, 2)))
            panel.set(xticks=[], yticks=[])
            panel.spines[:].set_visible(False)
        line[0].set_ylabel(f"scene {scene}", color=style.INK)
    for panel, title in zip(axes[0], [f"Table, {first} user’s margins", *map(style.label, columns)], strict=True):
        panel.set_title(title)
    names = ["neither", f"{first} only", f"{second} only", "both"]
    handles = [Patch(facecolor=KINDS(i), edgecolor=style.MUTED, label=f"valid for {n}") for i, n in enumerate(names)]
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def margins(results: Results) -> pd.DataFrame:
    """Return each user's margins, and the share of random paths valid to them: here and in the paper."""
    rows = pd.DataFrame([{"user": user} | {s: rules[s] for s in SYMBOLS} for user, rules in results.users.items()])
    valid = [results.value("p_valid", "truth", user=user, added="none") for user in results.users]
    paper = PAPER_TABLE_2["none"].reindex(rows["user"]).to_numpy()
    return rows.astype(dict.fromkeys(SYMBOLS, float)).assign(valid=list(map(float, valid)), paper=paper)


def overlap(results: Results) -> pd.DataFrame:
    """Return which test paths with unseen items are valid to two users: by the truth, each shown model, and blindly."""
    return slices.overlap(results.table("judged"), results.pair, "new_items")


def reactions(results: Results) -> pd.DataFrame:
    """Return what each user reacts to: the effect of each added item by the truth, by models, and without an image."""
    truth, answers = _answers(results, "add")
    return pd.concat([truth, answers, truth.assign(variant="blind", effect=0.0)], ignore_index=True)


def change_of_user(results: Results) -> pd.DataFrame:
    """Return the effect of do(S := other) for each user and other: the truth, the shown models', and by counting.

    Counting: the difference between the two users' shares of valid random paths, which needs no image.
    """
    truth, answers = _answers(results, "user")
    share = results.table("p_valid").query("added == 'none'").set_index("user")["truth"]
    others = truth["question"].str.removeprefix("another_user_")
    counted = share[others].to_numpy() - share[truth["user"]].to_numpy()
    rows = pd.concat([truth, answers, truth.assign(variant="Counting valid paths", effect=counted)], ignore_index=True)
    return rows.assign(other=rows["question"].str.removeprefix("another_user_"))


def _answers(results: Results, kind: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the true effects of the questions of a kind, as answers without quartiles, and the models' answers."""
    asked = results.table("interventions").query("kind == @kind")
    truth = asked[asked["variant"] == results.variants[0]]
    return truth.assign(variant="truth", effect=truth["truth"], q1=np.nan, q3=np.nan), asked[
        asked["variant"].isin(REACTS)
    ]
