"""Accuracy over all draws of test scenes."""

from matplotlib.figure import Figure

from pipeline.report.drawing import panels
from pipeline.report.pages.accuracy.figures import label_ends
from pipeline.report.results import Results
from pipeline.report.style import INK, colour, label, marker

VARIANTS = ("clearance", "irl_ranked", "irl_maxent", "full")


def draws(results: Results) -> Figure:
    """Draw accuracy with unseen items by draw of test scenes, and this run's as larger marks."""
    figure, axes = panels(1, 1, 11.0, 4.6)
    panel, table, ends = axes[0, 0], results.tables["draws"], []
    this, last = results.facts["root_seed"], int(max(table["root_seed"].max(), results.facts["root_seed"]))
    for name in VARIANTS:
        rows = table.dropna(subset=[name])
        panel.plot(rows["root_seed"], 100 * rows[name], marker=marker(name), markersize=5, color=colour(name))
        end = float(100 * rows[name].iloc[-1])
        if name in results.variants:
            end = 100 * results.accuracy(name, "new_items")
            panel.plot(this, end, marker(name), color=colour(name), markersize=11, markeredgecolor=INK)
        ends.append((end, label(name), colour(name)))
    label_ends(panel, float(last), ends)
    panel.set(xlabel="root seed of the test scenes, in the order they were opened", ylabel="accuracy, per cent")
    panel.set_xticks([int(seed) for seed in table["root_seed"]])
    panel.grid(axis="y")
    return figure
