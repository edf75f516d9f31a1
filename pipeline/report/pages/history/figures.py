"""Accuracy over all draws of test scenes."""

from matplotlib.figure import Figure

from pipeline.report.drawing import label_ends, panels
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
        of_series(panel.plot(rows["root_seed"], 100 * rows[name], color=colour(name), linewidth=2)[0], name)
        for x, y in zip(rows["root_seed"], 100 * rows[name], strict=True):
            mark = panel.plot(x, y, marker(name), markersize=5, color=colour(name))[0]
            of_series(mark, name, f"{label(name)}, scenes of {x}: {y:.1f} %")
        ends[name] = float(100 * rows[name].iloc[-1])
        if name in results.variants:
            ends[name] = 100 * results.accuracy(name, "new_items")
            mark = panel.plot(this, ends[name], marker(name), color=colour(name), markersize=11, markeredgecolor=INK)[0]
            of_series(mark, name, f"{label(name)}, this report: {ends[name]:.1f} %")
    panel.set(xlabel="root seed of the test scenes, in the order they were opened", ylabel="accuracy, per cent")
    panel.set_xticks(sorted({*seeds, this}))
    panel.grid(axis="y")
    label_ends(panel, max(*seeds, this), ends)
    return figure
