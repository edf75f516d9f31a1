"""Draw what the paper's model reaches, what clear cases give without the image, and the map of both claims."""

from itertools import product

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pipeline.report import style
from pipeline.report.drawing import panels
from pipeline.report.study import Study
from studies.chance.tables import SPLITS, name_of

DARK, LIGHT = "#111417", "white"  # of the map, in every colour scheme
BLIND = {"seen_scenes": "nearest_demonstration", "new_scenes": "position_only"}


def reached(study: Study) -> Figure:
    """Draw accuracy with quartiles on training scenes and in new ones: the paper's model, a bound and baselines."""
    table = study.table("accuracy.csv", finite=("accuracy", "q1", "q3"))
    few = table.loc[table["source"] == "ceiling", "scenes"].replace(0, np.nan).min()
    rows = {
        "The paper": None,
        "Default setting": {"source": "evaluate", "learner": "full"},
        "Best of the search": {"source": "search", "learner": "full"},
        "Perfect encoder": {"source": "ceiling", "learner": "perfect", "scenes": few, "clear_cm": 0},
        "Nearest demonstration": {"source": "evaluate", "learner": "nearest_demonstration"},
        "Position only": {"source": "evaluate", "learner": "position_only"},
    }
    figure, axes = panels(1, 1, 5.0, 3.8)
    axes = axes[0, 0]
    marks = {"seen_scenes": (-0.16, "o", style.INK), "new_scenes": (0.16, "D", style.colour("full"))}
    for (y, where), (split, (offset, marker, colour)) in product(enumerate(rows.values()), marks.items()):
        if where is None:
            part = [(study.settings["accuracy"], study.settings["q1"], study.settings["q3"])]
            part = part if split == "seen_scenes" else []
        else:
            chosen = table[(table[[*where, "split"]] == [*where.values(), split]).all(axis=1)]
            part = chosen[["accuracy", "q1", "q3"]].to_numpy()
        for mean, low, high in part:
            axes.hlines(y + offset, 100 * low, 100 * high, color=colour, linewidth=2)
            label = SPLITS[split] if y == 1 else None
            axes.plot(100 * mean, y + offset, marker, color=colour, markersize=7, linestyle="", label=label)
    axes.set(
        yticks=range(len(rows)), ylim=(len(rows) - 0.5, -0.5), xlim=(48, 101), xlabel="paths judged right, per cent"
    )
    axes.set_yticklabels(rows)
    axes.grid(axis="x")
    figure.legend(loc="outside lower center", ncols=2)
    return figure


def clear_cases(study: Study) -> Figure:
    """Draw accuracy on held-out paths of the training scenes against clearness, with and without the image."""
    table = study.table("accuracy.csv", finite=("accuracy", "q1", "q3"))
    table = table[(table["source"] == "demonstrations") & (table["split"] == "held_out")]
    figure, axes = panels(1, 1, 5.0, 3.8)
    axes = axes[0, 0]
    names = {"full": "Paper’s model", "nearest_demonstration": "Nearest demonstration"}
    for (learner, name), (routes, line) in product(names.items(), {"any": "-", "few": "--"}.items()):
        rows = table[(table["learner"] == learner) & (table["routes"] == routes)]
        colour, marker = (style.colour("full"), "o") if learner == "full" else (style.INK, "s")
        label = f"{name}, {routes} routes"
        axes.plot(rows["clear_cm"], 100 * rows["accuracy"], line, color=colour, marker=marker, label=label)
        axes.fill_between(rows["clear_cm"], 100 * rows["q1"], 100 * rows["q3"], color=colour, alpha=0.12, linewidth=0)
    axes.axhspan(100 * study.settings["q1"], 100 * study.settings["q3"], color=style.MUTED, alpha=0.35, linewidth=0)
    axes.annotate("the paper", (0, 100 * study.settings["q1"]), (0, -13), textcoords="offset points", fontsize=10)
    axes.set(xlabel="least distance from the user’s margin, cm", ylabel="paths judged right, per cent", ylim=(50, 101))
    axes.set_xticks(sorted(set(table["clear_cm"])))
    axes.grid(axis="y")
    figure.legend(loc="outside lower center", ncols=2, fontsize=9)
    return figure


def claims_map(study: Study) -> Figure:
    """Draw accuracy by clearness and number of training scenes; framed: the paper's rate is reached.

    Learners in rows, training scenes and new scenes in columns; each panel's first column is the image-blind baseline.
    """
    table = study.table("accuracy.csv", finite=("accuracy",))
    table = table[table["source"] == "ceiling"]
    numbers, distances = (
        sorted(set(table["scenes"])),
        sorted(set(table["clear_cm"])),
    )  # the first number is 0: baselines
    learners = ["full", "perfect"]
    figure, axes = panels(len(learners), len(SPLITS), 3.7, 4.4, sharex=True, sharey=True)
    for (i, learner), (j, split) in product(enumerate(learners), enumerate(SPLITS)):
        panel = axes[i, j]
        rows = table[table["learner"].isin([learner, BLIND[split]]) & (table["split"] == split)]
        for row in rows.to_dict("records"):
            x, y = numbers.index(row["scenes"]), distances.index(row["clear_cm"])
            _cell(panel, x, y, row["accuracy"], bool(row["reaches"]))
        panel.set_title(f"{name_of(learner)}\n{SPLITS[split].lower()}", fontsize=9)
        panel.set(xlim=(-0.5, len(numbers) - 0.5), ylim=(-0.5, len(distances) - 0.5))
        panel.set_xticks(range(len(numbers)), ["blind", *(f"{number:,.0f}" for number in numbers[1:])])
        panel.set_yticks(range(len(distances)), [f"{distance:.0f}" for distance in distances])
        panel.tick_params(length=0, labelsize=8, pad=1)
        panel.spines[:].set_visible(False)
    for panel in axes[-1]:
        panel.set_xlabel("training tables", fontsize=9)
    for panel in axes[:, 0]:
        panel.set_ylabel("clear by, cm", fontsize=9)
    return figure


def _cell(axes: Axes, x: int, y: int, rate: float, reaches: bool) -> None:
    """Draw one rate in per cent on grey, the darker the higher; framed if it reaches the paper's."""
    grey = str(round(1 - 0.85 * float(np.clip(2 * rate - 1, 0, 1)), 3))
    axes.add_patch(Rectangle((x - 0.47, y - 0.47), 0.94, 0.94, facecolor=grey, edgecolor="none"))
    ink = LIGHT if float(grey) < 0.5 else DARK
    if reaches:
        axes.add_patch(Rectangle((x - 0.41, y - 0.41), 0.82, 0.82, facecolor="none", edgecolor=ink, linewidth=1.5))
    axes.text(x, y, f"{100 * rate:.0f}", ha="center", va="center", color=ink, fontsize=9)
