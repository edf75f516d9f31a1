"""Draw the invalid and valid paths that each rule accepts, by the promised share of invalid ones."""

from itertools import product

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import panels
from pipeline.report.study import Study

LINES = {"conformal": ("-", "conformal selection"), "threshold": ("--", "P(valid) > 1/2")}


def by_level(study: Study) -> Figure:
    """Draw, against the promise, invalid paths among the accepted ones in each split, and valid paths accepted."""
    table = study.table("curve.csv", finite=("invalid", "ci_low", "ci_high", "power"))
    splits = list(dict.fromkeys(table["split"]))
    variants = [variant for variant in dict.fromkeys(table["variant"]) if variant != "position_only"]
    levels = sorted(set(table["level"]))
    figure, axes = panels(1, len(splits) + 1, 4.1 * (len(splits) + 1), 4.0, sharex=True)
    for panel, split in zip(axes[0], splits, strict=False):
        panel.plot(levels, levels, color=style.INK, linewidth=1.2, linestyle=":", label="promised")
        panel.set(title=f"{style.label(split)}: invalid among accepted", ylim=(0, 0.11), xticks=levels[1:])
    accepted = axes[0, -1]
    accepted.set(title=f"{style.label(splits[-1])}: valid paths accepted", ylim=(-0.03, 1.03))
    for variant, (rule, (line, name)) in product(variants, LINES.items()):
        own = table[(table["variant"] == variant) & (table["rule"] == rule)].set_index("split")
        marks = {"color": style.colour(variant), "linestyle": line, "linewidth": 2}
        for panel, split in zip(axes[0], splits, strict=False):
            rows = own.loc[split]
            panel.plot(rows["level"], rows["invalid"], label=f"{style.label(variant)}, {name}", **marks)
            panel.fill_between(rows["level"], rows["ci_low"], rows["ci_high"], color=style.colour(variant), alpha=0.13)
        accepted.plot(own.loc[splits[-1], "level"], own.loc[splits[-1], "power"], **marks)
    for panel in axes[0]:
        panel.set_xlabel("promised share")
        panel.grid(axis="y")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=10)
    return figure
