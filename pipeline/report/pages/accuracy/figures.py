"""Accuracy by the number of demonstrations and by distance to the boundary, and calibration."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pipeline.report.drawing import panels
from pipeline.report.results import PAPER_ACCURACY, Results
from pipeline.report.slices import DISTANCE_LABELS
from pipeline.report.style import INK, MUTED, colour, label, marker

MIN_PATHS = 20  # fewest paths in a bin that is drawn
SPLITS = ("seen_scenes", "new_scenes", "new_items")
LABEL_GAP = 2.8  # between the labels of two lines [per cent]
PAPER_VARIANTS = ("full", "ae", "classifier")
BLIND = ("position_only", "nearest_demonstration")
SHORT = {"position_only": "Position only", "nearest_demonstration": "Nearest demonstration", "ae": "β = 0"}


def by_demonstrations(results: Results) -> Figure:
    """Draw one panel per split: mean accuracy and quartiles over seeds against demonstrations per scene."""
    figure, axes = panels(1, 3, 13.0, 4.6, sharey=True)
    table = results.tables["accuracy"]
    for panel, split in zip(axes[0], SPLITS, strict=True):
        ends = []
        for name, rows in table[table["split"] == split].groupby("variant", sort=False):
            name, rows = str(name), rows.sort_values("n_demos")
            known = name in results.variants
            marks = {"marker": marker(name) if known else "", "linestyle": "-" if known else "--"}
            panel.plot(rows["n_demos"], 100 * rows["mean"], color=colour(name), linewidth=2, markersize=5, **marks)
            if known and rows["q1"].notna().all():
                panel.fill_between(rows["n_demos"], 100 * rows["q1"], 100 * rows["q3"], color=colour(name), alpha=0.15)
            ends.append((float(100 * rows["mean"].iloc[-1]), name))
        if split == "seen_scenes":
            for n, (mean, low, high) in PAPER_ACCURACY.items():
                error = [[100 * (mean - low)], [100 * (high - mean)]]
                panel.errorbar(n, 100 * mean, yerr=error, fmt="*", color=INK, markersize=12)
            options = {"textcoords": "offset points", "ha": "right", "fontsize": 10}
            panel.annotate("the paper", (9, 100 * PAPER_ACCURACY[9][0]), (8, 9), **options)
        label_ends(panel, float(max(results.n_demos)), _grouped(ends))
        panel.set(title=label(split), xlabel="demonstrations a scene", xticks=results.n_demos)
        panel.grid(axis="y")
    axes[0, 0].set(ylabel="accuracy, per cent", ylim=(None, 104))
    return figure


def _grouped(ends: Sequence[tuple[float, str]]) -> list[tuple[float, str, str]]:
    """Return (y, text, colour) of the lines' ends; the paper's variants have one label if they end close together."""
    paper = [y for y, name in ends if name in PAPER_VARIANTS]
    if len(paper) < 2 or max(paper) - min(paper) > 2 * LABEL_GAP:
        return [(y, SHORT.get(name, label(name)), colour(name)) for y, name in ends]
    others = [(y, SHORT.get(name, label(name)), colour(name)) for y, name in ends if name not in PAPER_VARIANTS]
    return [*others, (float(np.mean(paper)), "Paper’s model, ablations", colour("full"))]


def label_ends(axes: Axes, x: float, ends: Sequence[tuple[float, str, str]], gap: float = LABEL_GAP) -> None:
    """Write each (y, text, colour) to the right of its line's end, moved apart where labels would overlap."""
    ordered = sorted(ends)
    places = np.array([y for y, *_ in ordered])
    for _ in range(200):
        close = np.flatnonzero(np.diff(places) < gap - 1e-6)
        if not len(close):
            break
        places[close[0]] -= (gap - (places[close[0] + 1] - places[close[0]])) / 2
        places[close[0] + 1] = places[close[0]] + gap
    for place, (y, text, hue) in zip(places, ordered, strict=True):
        options = {"xytext": (x + 0.05 * axes.dataLim.width, place), "va": "center", "fontsize": 10, "color": INK}
        axes.annotate(text, (x, y), arrowprops={"arrowstyle": "-", "color": hue, "shrinkA": 0}, **options)


def by_distance(results: Results) -> Figure:
    """Draw accuracy in the training scenes against a path's distance to the boundary, with the share of paths."""
    figure, axes = panels(1, 1, 8.6, 4.2)
    panel, table = axes[0, 0], results.tables["slices"]
    table = table[(table["split"] == "seen_scenes") & (table["slice"] == "distance")]
    shown = [v for v in ("clearance", "irl_ranked", "nearest_demonstration", "full") if v in set(table["variant"])]
    ends, x = [], np.arange(len(DISTANCE_LABELS))
    for name in shown:
        rows = table[table["variant"] == name].set_index("value").reindex(DISTANCE_LABELS)
        blind = name in BLIND
        panel.plot(
            x, 100 * rows["accuracy"], "--" if blind else "-", marker="" if blind else marker(name), color=colour(name)
        )
        ends.append((float(100 * rows["accuracy"].iloc[-1]), SHORT.get(name, label(name)), colour(name)))
    label_ends(panel, float(x[-1]), ends)
    share = table[table["variant"] == shown[-1]].set_index("value")["share"].reindex(DISTANCE_LABELS).fillna(0)
    panel.set_xticks(x, [f"{name}\n{100 * part:.0f} % of paths" for name, part in share.items()])
    panel.set(xlabel="distance of the path to the user’s boundary", ylabel="accuracy, per cent", ylim=(45, 102))
    panel.grid(axis="y")
    return figure


def calibration(results: Results) -> Figure:
    """Draw the true share of valid paths against the predicted P(valid), in new scenes with unseen items."""
    figure, axes = panels(1, 1, 6.4, 5.4)
    panel, table = axes[0, 0], results.tables["calibration"]
    panel.plot([0, 1], [0, 1], color=MUTED, linewidth=1, linestyle=":")
    panel.fill_between([0, 1], [0, 1], 0, color=MUTED, alpha=0.1, linewidth=0)
    panel.text(0.97, 0.05, "promises too much:\nthe unsafe side", ha="right", va="bottom", color=MUTED)
    for name in [v for v in results.variants if v in ("full", "irl_ranked", "clearance")] or results.variants:
        rows = table[(table["variant"] == name) & (table["split"] == "new_items") & (table["count"] >= MIN_PATHS)]
        panel.plot(rows["confidence"], rows["frequency"], color=colour(name), marker=marker(name), label=label(name))
    panel.set(xlabel="P(valid) as stated", ylabel="share truly valid", xlim=(0, 1), ylim=(0, 1))
    panel.legend(loc="upper left")
    return figure
