"""Users named by the number of labelled paths."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import panels
from pipeline.report.study import Study
from studies.identification.tables import name_of

TITLES = {"": "all scenes", "distinct_": "scenes in which all users differ"}
SHOWN = ("full", "irl_ranked", "clearance")
REFERENCES = {"position_only": (style.MUTED, ":"), "ideal": (style.INK, "--")}


def by_paths(study: Study) -> Figure:
    """Draw the share of users named correctly against the number of labelled paths, with 95 % intervals."""
    table = study.table("curve.csv", finite=("accuracy", "distinct_accuracy"))
    table = table[table["user"] == "all"]
    figure, axes = panels(1, 2, 12.0, 4.6, sharey=True)
    for panel, (prefix, title) in zip(axes[0], TITLES.items(), strict=True):
        for variant in [*(v for v in SHOWN if v in study.variants), *REFERENCES]:
            rows = table[table["variant"] == variant]
            colour, line = REFERENCES.get(variant, (style.colour(variant), "-"))
            panel.plot(
                rows["k"],
                100 * rows[f"{prefix}accuracy"],
                color=colour,
                linestyle=line,
                linewidth=2,
                label=name_of(variant),
            )
            low, high = (100 * rows[f"{prefix}{end}"] for end in ("ci_low", "ci_high"))
            panel.fill_between(rows["k"], low, high, color=colour, alpha=0.12)
        panel.axhline(100 / len(study.users), color=style.MUTED, linewidth=1, linestyle=(0, (1, 3)))
        panel.set(title=title, xlabel="labelled paths", xticks=study.settings["reported"], ylim=(25, 102))
        panel.grid(axis="y")
    axes[0, 0].set_ylabel("user named correctly, per cent")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=10)
    return figure
