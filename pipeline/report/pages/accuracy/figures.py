"""Accuracy by the number of demonstrations, and calibration."""

from matplotlib.figure import Figure

from pipeline.report.drawing import panels
from pipeline.report.results import PAPER_ACCURACY, Results
from pipeline.report.style import INK, MUTED, colour, label, marker

MIN_PATHS = 20  # fewest paths in a bin that is drawn
SPLITS = ("seen_scenes", "new_scenes", "new_items")


def by_demonstrations(results: Results) -> Figure:
    """Draw one panel per split: mean accuracy and quartiles over seeds against demonstrations per scene."""
    figure, axes = panels(1, 3, 12.0, 4.4, sharey=True)
    table = results.tables["accuracy"]
    for panel, split in zip(axes[0], SPLITS, strict=True):
        for name, rows in table[table["split"] == split].groupby("variant", sort=False):
            rows = rows.sort_values("n_demos")
            known = name in results.variants
            line = "-" if known else ":" if name == "position_only" else "--"
            marks = {"marker": marker(str(name)) if known else "", "linestyle": line, "label": label(str(name))}
            panel.plot(rows["n_demos"], 100 * rows["mean"], color=colour(str(name)), linewidth=2, **marks)
            if known and rows["q1"].notna().all():
                panel.fill_between(
                    rows["n_demos"], 100 * rows["q1"], 100 * rows["q3"], color=colour(str(name)), alpha=0.15
                )
        if split == "seen_scenes":
            for n, (mean, low, high) in PAPER_ACCURACY.items():
                error = [[100 * (mean - low)], [100 * (high - mean)]]
                panel.errorbar(
                    n, 100 * mean, yerr=error, fmt="*", color=INK, markersize=12, label="The paper" if n == 9 else None
                )
        panel.set(title=label(split), xlabel="demonstrations a scene", xticks=results.n_demos)
        panel.grid(axis="y")
    axes[0, 0].set_ylabel("accuracy, per cent")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=10)
    return figure


def calibration(results: Results) -> Figure:
    """Draw the true share of valid paths against the predicted P(valid), in new scenes with unseen items."""
    figure, axes = panels(1, 1, 5.6, 5.2)
    panel, table = axes[0, 0], results.tables["calibration"]
    panel.plot([0, 1], [0, 1], color=MUTED, linewidth=1, linestyle=":")
    for name in [v for v in results.variants if v in ("full", "irl_ranked", "clearance")] or results.variants:
        rows = table[(table["variant"] == name) & (table["split"] == "new_items") & (table["count"] >= MIN_PATHS)]
        panel.plot(rows["confidence"], rows["frequency"], color=colour(name), marker=marker(name), label=label(name))
    panel.set(xlabel="P(valid) as stated", ylabel="share truly valid", xlim=(0, 1), ylim=(0, 1))
    panel.legend(loc="upper left")
    return figure
