"""Accuracy against the number of training scenes, in training scenes and in new ones."""

from typing import Any

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import panels
from pipeline.report.study import Study
from studies.ceiling.tables import name_of

TITLES = {"seen_scenes": "Other paths, training tables", "new_scenes": "New tables"}


def by_scenes(study: Study) -> Figure:
    """Draw mean accuracy with quartiles over training sets; dotted lines are image-blind baselines."""
    table = study.table("summary.csv", finite=("accuracy", "q1", "q3"))
    table = table[table["clear_cm"] == 0]
    figure, axes = panels(1, 2, 12.0, 5.0, sharex=True, sharey=True)
    for panel, (split, title) in zip(axes[0], TITLES.items(), strict=True):
        for learner, rows in table[table["split"] == split].groupby("learner", sort=False):
            name = str(learner)
            if not rows["scenes"].any():
                line = ":" if name == "position_only" else "-."
                panel.axhline(100 * rows["accuracy"].iloc[0], color=style.MUTED, linestyle=line, label=name_of(name))
                continue
            colour, marker = (style.INK, "*") if name == "perfect" else (style.colour(name), style.marker(name))
            marks: dict[str, Any] = {"marker": marker, "color": colour}
            rows = 100 * rows.set_index("scenes")[["accuracy", "q1", "q3"]].sort_index()
            panel.plot(rows.index, rows["accuracy"], label=name_of(name), linewidth=2, markersize=7, **marks)
            panel.fill_between(rows.index, rows["q1"], rows["q3"], color=colour, alpha=0.13, linewidth=0)
            panel.set_xscale("log")
        panel.set(title=title, xlabel="training tables", ylim=(48, 101))
        panel.grid(axis="y")
    numbers = sorted(set(table["scenes"]) - {0})
    axes[0, 0].set_xticks(numbers, [f"{number:,}" for number in numbers])
    axes[0, 0].minorticks_off()
    axes[0, 0].set_ylabel("paths judged right, per cent")
    handles = {
        text: handle for panel in axes[0] for handle, text in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=4, fontsize=10)
    return figure
