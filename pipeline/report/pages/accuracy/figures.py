"""Accuracy by the number of demonstrations and by distance to the boundary, and calibration."""

import numpy as np
from matplotlib.figure import Figure

from pipeline.report.drawing import label_ends, panels
from pipeline.report.results import PAPER_ACCURACY, Results
from pipeline.report.slices import DISTANCE_LABELS
from pipeline.report.style import INK, MUTED, colour, label, marker, of_series

MIN_PATHS = 20  # fewest paths in a bin that is drawn
SPLITS = ("seen_scenes", "new_scenes", "new_items")


def by_demonstrations(results: Results) -> Figure:
    """Draw one panel per split: mean accuracy and quartiles over seeds against demonstrations per scene."""
    figure, axes = panels(1, 3, 12.4, 4.6, sharey=True)
    table = results.tables["accuracy"]
    for panel, split in zip(axes[0], SPLITS, strict=True):
        ends = {}
        for name, rows in table[table["split"] == split].groupby("variant", sort=False):
            rows, name = rows.sort_values("n_demos"), str(name)
            n, mean, known = rows["n_demos"], 100 * rows["mean"], name in results.variants
            line = "-" if known else ":" if name == "position_only" else "--"
            of_series(panel.plot(n, mean, color=colour(name), linewidth=2, linestyle=line)[0], name)
            if known:
                of_series(
                    panel.fill_between(n, 100 * rows["q1"], 100 * rows["q3"], color=colour(name), alpha=0.15), name
                )
            for x, y in zip(n, mean, strict=True):
                mark = panel.plot(x, y, marker(name) if known else ".", color=colour(name), markersize=6)[0]
                of_series(mark, name, f"{label(name)}, {x} demonstrations: {y:.1f} %")
            ends[name] = mean.iloc[-1]
        if split == "seen_scenes":
            for n, (mean, low, high) in PAPER_ACCURACY.items():
                error = [[100 * (mean - low)], [100 * (high - mean)]]
                panel.errorbar(n, 100 * mean, yerr=error, fmt="*", color=INK, markersize=12)
            panel.annotate("the paper", (9, 99), (4, 10), textcoords="offset points", ha="right")
            if (nearest := ends.get("nearest_demonstration")) is not None:
                below = {"textcoords": "offset points", "ha": "right", "va": "top"}
                panel.annotate("nearest demonstration", (max(results.n_demos), nearest), (4, -46), **below)
        panel.set(title=label(split), xlabel="demonstrations a scene", xticks=results.n_demos)
        panel.grid(axis="y")
    axes[0, 0].set(ylabel="accuracy, per cent", ylim=(None, 105))
    label_ends(axes[0, -1], max(results.n_demos), ends)
    return figure


def by_distance(results: Results) -> Figure:
    """Draw accuracy in the training scenes against a path's distance to the boundary, with the share of paths."""
    figure, axes = panels(1, 1, 9.6, 4.4)
    panel, table = axes[0, 0], results.tables["slices"]
    table = table[(table["split"] == "seen_scenes") & (table["slice"] == "distance")]
    ends, x = {}, np.arange(len(DISTANCE_LABELS))
    for name, rows in table.groupby("variant", sort=False):
        name, accuracy = str(name), 100 * rows.set_index("value")["accuracy"].reindex(DISTANCE_LABELS)
        known = name in results.variants
        of_series(panel.plot(x, accuracy, "-" if known else "--", color=colour(name), linewidth=2)[0], name)
        for place, y in zip(x, accuracy, strict=True):
            mark = panel.plot(place, y, marker(name) if known else ".", color=colour(name), markersize=6)[0]
            of_series(mark, name, f"{label(name)}, {DISTANCE_LABELS[place]}: {y:.0f} %")
        ends[name] = float(accuracy.iloc[-1])
    share = table.groupby("value")["share"].first().reindex(DISTANCE_LABELS).fillna(0)
    panel.set_xticks(x, [f"{name}\n{100 * part:.0f} % of paths" for name, part in share.items()])
    panel.set(xlabel="distance of the path to the user’s boundary", ylabel="accuracy, per cent", ylim=(45, 102))
    panel.grid(axis="y")
    label_ends(panel, len(x) - 1, ends)
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
