"""Accuracy of the clearance model by slices of the test paths."""

from matplotlib.figure import Figure

from pipeline.report.drawing import panels
from pipeline.report.pages.card.tables import slice_rows
from pipeline.report.pages.limits.figures import failing
from pipeline.report.results import Results
from pipeline.report.slices import SLICES
from pipeline.report.style import MUTED, colour, marker


def slices(results: Results) -> Figure:
    """Draw accuracy of every slice with unseen items, grouped, beside the accuracy of all paths."""
    variant, rows = failing(results), slice_rows(results)
    figure, axes = panels(1, 1, 8.8, 0.27 * (len(rows) + len(SLICES)) + 0.9)
    panel, y, ticks, names = axes[0, 0], 0.0, [], []
    left = min(75, 100 * rows["accuracy"].min() - 5)
    for name, part in rows.groupby("slice", sort=False):
        panel.text(left + 0.3, y - 0.6, SLICES[str(name)], va="center", fontsize=10, color=MUTED)
        for value, accuracy in part[["value", "accuracy"]].itertuples(index=False):
            panel.plot(100 * accuracy, y, marker(variant), color=colour(variant), markersize=8)
            panel.annotate(f"{100 * accuracy:.0f}", (100 * accuracy, y), (-9, 0), textcoords="offset points",
                           ha="right", va="center", fontsize=9)  # fmt: skip
            ticks.append(y)
            names.append(f"{value} items" if name == "items" else value)
            y += 1
        y += 1
    panel.axvline(100 * results.sliced(variant, "accuracy"), color=MUTED, linestyle="--", zorder=0)
    panel.set_yticks(ticks, names)
    panel.set(ylim=(y - 1.2, -1.2), xlim=(left, 100.8), xlabel="accuracy, per cent; broken line: all paths")
    panel.grid(axis="x")
    return figure
