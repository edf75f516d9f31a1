"""Users named by the number of labelled paths."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_band, legend_below, panels
from pipeline.report.study import Study

TITLES = {"": "all scenes", "distinct_": "scenes in which all users differ"}
SHOWN = ("full", "irl_ranked", "clearance")
REFERENCES = {"position_only": ":", "ideal": "--"}


def by_paths(study: Study) -> Figure:
    """Draw the share of users named correctly against the number of labelled paths, with 95 % intervals."""
    table = study.table("curve.csv", finite=("accuracy", "distinct_accuracy"))
    table = table[table["user"] == "all"]
    figure, axes = panels(1, 2, 12.0, 4.6, sharey=True)
    for panel, (prefix, title) in zip(axes[0], TITLES.items(), strict=True):
        for variant in [*(v for v in SHOWN if v in study.variants), *REFERENCES]:
            rows = table[table["variant"] == variant]
            middle, low, high = (100 * rows[f"{prefix}{column}"] for column in ("accuracy", "ci_low", "ci_high"))
            draw_band(panel, rows["k"], middle, low, high, variant, linestyle=REFERENCES.get(variant, "-"))
        panel.axhline(100 / len(study.users), color=style.MUTED, linewidth=1, linestyle=(0, (1, 3)))
        panel.set(title=title, xlabel="labelled paths", xticks=study.settings["reported"], ylim=(25, 102))
        panel.grid(axis="y")
    axes[0, 0].set_ylabel("user named correctly, per cent")
    legend_below(figure, axes[0, 0], 5)
    return figure
