"""One scene under the disturbances, and accuracy by their strength."""

from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_map, draw_table, legend_below, panels
from pipeline.report.study import Study
from studies.robustness.tables import LABELS, SHOWN

MAPS = ("clearance", "full")  # models whose maps are drawn
BASELINE = "position_only"


def same_scene(study: Study) -> Figure:
    """Draw the first scene as it is and disturbed: image, true map of the first judged user, and models' maps."""
    examples, user = study.arrays("examples.npz"), study.judged_users[0]
    names = [str(name) for name in examples["names"]]
    wanted = ("none", "texture", "noise", "blur", "arm", "clutter")
    first = {kind: next((i for i, name in enumerate(names) if name.startswith(kind)), None) for kind in wanted}
    columns = [i for i in first.values() if i is not None]
    rows = ["truth", *(variant for variant in MAPS if variant in examples)]
    figure, axes = panels(1 + len(rows), len(columns), 2.1 * len(columns), 2.2 * (1 + len(rows)))
    for line, i in zip(axes.T, columns, strict=True):
        draw_table(line[0], examples["images"][i])
        line[0].set_title(_title(names[i]))
        for panel, name in zip(line[1:], rows, strict=True):
            draw_map(panel, examples[name][i, 0])
    for panel, name in zip(axes[1:, 0], rows, strict=True):
        panel.set_ylabel(f"Truth, {user} user" if name == "truth" else style.label(name), color=style.INK)
    return figure


def by_strength(study: Study) -> Figure:
    """Draw one panel per disturbance: accuracy of models and of the image-blind baseline at each strength."""
    table = study.table("summary.csv", finite=("accuracy", "ci_low", "ci_high"))
    kinds = [kind for kind in LABELS if kind in set(table["corruption"])]
    figure, axes = panels(2, -(-len(kinds) // 2), 12.6, 6.6, sharey=True)
    for panel in axes.flat[len(kinds) :]:
        panel.set_visible(False)
    for panel, kind in zip(axes.flat, kinds, strict=False):
        rows = table[table["corruption"].isin(["none", kind])]
        strengths = list(dict.fromkeys(rows["strength"]))
        for name in [*(variant for variant in SHOWN if variant in study.variants), BASELINE]:
            line = rows[rows["variant"] == name]
            x = [strengths.index(strength) for strength in line["strength"]]
            joined = "" if kind == "texture" else ":" if name == BASELINE else "-"
            marks = {"marker": "_" if name == BASELINE else style.marker(name), "linestyle": joined}
            panel.plot(x, 100 * line["accuracy"], color=style.colour(name), label=style.label(name), **marks)
            panel.vlines(x, 100 * line["ci_low"], 100 * line["ci_high"], color=style.colour(name), linewidth=1.5)
        panel.set_xticks(range(len(strengths)), ["none", *strengths[1:]])
        panel.set(title=LABELS[kind], ylim=(45, 102), xlim=(-0.3, len(strengths) - 0.7))
        panel.grid(axis="y")
    for panel in axes[:, 0]:
        panel.set_ylabel("accuracy, per cent")
    legend_below(figure, axes[0, 0], 5)
    return figure


def _title(name: str) -> str:
    """Return the title of an example: its disturbance, or the name of its table top."""
    kind, _, strength = name.partition(" ")
    return "as it is" if kind == "none" else strength if kind == "texture" else LABELS[kind]
