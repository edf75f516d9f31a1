"""Accuracy over all draws of test scenes."""

from matplotlib.figure import Figure

from pipeline.report.drawing import draw_series, label_ends, panels
from pipeline.report.results import Results
from pipeline.report.style import INK, colour, label, marker, of_series

VARIANTS = ("clearance", "irl_ranked", "irl_maxent", "full")


def draws(results: Results) -> Figure:
    """Draw accuracy with unseen items by draw of test scenes, and this run's as larger marks."""
    figure, axes = panels(1, 1, 11.0, 4.6)
    panel, table, ends = axes[0, 0], results.tables["draws"], {}
    this, seeds = results.facts["root_seed"], [int(seed) for seed in table["root_seed"]]
    for name in VARIANTS:
        rows = table.dropna(subset=[name])
        places = [f"scenes of {seed}" for seed in rows["root_seed"]]
        ends[name] = draw_series(panel, rows["root_seed"], 100 * rows[name], name, places, "-", marker(name))
        if name in results.variants:
            ends[name] = 100 * results.accuracy(name, "new_items")
            mark = panel.plot(this, ends[name], marker(name), color=colour(name), markersize=11, markeredgecolor=INK)[0]
            of_series(mark, name, f"{label(name)}, this report: {ends[name]:.1f} %")
    panel.set(xlabel="root seed of the test scenes, in the order they were opened", ylabel="accuracy, per cent")
    panel.set_xticks(sorted({*seeds, this}))
    panel.grid(axis="y")
    label_ends(panel, max(*seeds, this), ends)
    return figure
