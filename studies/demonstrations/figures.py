"""Draw demonstrations of each kind on one table, and accuracy by how clear the cases are."""

from itertools import product

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_path, draw_table, panels
from pipeline.report.results import PAPER_ACCURACY
from pipeline.report.study import Study

ROUTES = {"any": "any route", "few": "few families of routes"}
SPLITS = {"held_out": "Held-out paths, same tables", "new_scenes": "New tables"}
LINES = {"position_only": ":", "nearest_demonstration": "--"}


def shown(study: Study) -> Figure:
    """Draw one scene's demonstrations: at random, the clearest ones, and those of few families of routes."""
    examples, clearest = study.arrays("examples.npz"), study.settings["clear_cm"][-1]
    names = [str(name) for name in examples["names"]]
    kinds = {"any 0": "At random", f"any {clearest}": f"Clear by {clearest} cm"}
    kinds |= {"few 0": "Few families", f"few {clearest}": f"Few families, clear by {clearest} cm"}
    figure, axes = panels(1, len(kinds), 3.0 * len(kinds), 3.3)
    for panel, (name, title) in zip(axes[0], kinds.items(), strict=True):
        draw_table(panel, examples["image"])
        kind = names.index(name)
        for z, valid in zip(examples["z_theta"][kind], examples["valid"][kind], strict=True):
            draw_path(panel, z, style.VALID if valid else style.INVALID, linestyle="-" if valid else (0, (3, 1)))
        panel.set_title(title)
    return figure


def by_clearness(study: Study) -> Figure:
    """Draw accuracy against the distance that paths keep from the boundary, with quartiles over training sets."""
    table = study.table("summary.csv", finite=("accuracy", "q1", "q3"))
    figure, axes = panels(2, 2, 12.0, 8.4, sharex=True, sharey=True)
    for panel, (split, routes) in zip(axes.flat, product(SPLITS, ROUTES), strict=True):
        of_panel = table[(table["split"] == split) & (table["routes"] == routes)]
        for name, rows in of_panel.groupby("variant", sort=False):
            variant, x = str(name), rows["clear_cm"]
            marks = {"color": style.colour(variant), "marker": style.marker(variant)}
            line = LINES.get(variant, "-")
            panel.plot(x, 100 * rows["accuracy"], linestyle=line, linewidth=2, label=style.label(variant), **marks)
            panel.fill_between(x, 100 * rows["q1"], 100 * rows["q3"], color=marks["color"], alpha=0.13, linewidth=0)
        if split == "held_out":
            paper = PAPER_ACCURACY[study.main_n_demos][0] if study.main_n_demos in PAPER_ACCURACY else None
            if paper is not None:
                panel.axhline(100 * paper, color=style.INK, linewidth=1, linestyle=(0, (1, 2)), label="The paper")
        panel.set(title=f"{SPLITS[split]}, {ROUTES[routes]}", ylim=(45, 101), xticks=study.settings["clear_cm"])
        panel.grid(axis="y")
    for panel in axes[1]:
        panel.set_xlabel("least distance from the user's margin, cm")
    for panel in axes[:, 0]:
        panel.set_ylabel("paths judged right, per cent")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=10)
    return figure
