"""Worked examples of rejected paths with each item removed, and attributions by every model."""

import pandas as pd
from matplotlib.figure import Figure

from pipeline.report import style
from pipeline.report.drawing import draw_path, draw_table, panels
from pipeline.report.study import Study

TITLES = {
    "disagree": "users reject it for\ndifferent items",
    "one_accepts": "one user rejects it,\nthe other accepts it",
    "model_wrong": "the model names\nthe wrong item",
}
MODELS = {"truth": "truth", "clearance": "clearance", "full": "paper’s"}


def examples(study: Study) -> Figure:
    """Draw a row for each example: the table with its path, then without each item; P(valid) by user below each."""
    table, images = study.table("examples.csv"), study.arrays("examples.npz")
    kinds = list(dict.fromkeys(table["example"]))
    width = 1 + int(table.groupby("example")["slot"].nunique().max())
    figure, axes = panels(len(kinds), width, 3.3 * width, 4.6 * len(kinds))
    for row, (line, kind) in enumerate(zip(axes, kinds, strict=True)):
        rows = table[table["example"] == kind]
        slots = rows.drop_duplicates("slot")
        path = rows[["z_x", "z_y"]].iloc[0].to_numpy(float)
        versions = [("as it is", images["factual"][row], rows[rows["slot"] == slots["slot"].iloc[0]], "p")]
        for slot, symbol in zip(slots["slot"], slots["symbol"], strict=True):
            versions.append(
                (f"without this {symbol}", images["without"][row][slot], rows[rows["slot"] == slot], "p_without")
            )
        for panel, (title, image, answers, column) in zip(line, versions, strict=False):
            draw_table(panel, image)
            draw_path(panel, path, style.START)
            panel.set_title(title)
            panel.set_xlabel(_answers(answers, column), fontsize=14, family="DejaVu Sans Mono", loc="left")
        for panel, slot in zip(line[1:], slots.to_dict("records"), strict=False):
            panel.plot(slot["x_m"], slot["y_m"], "x", color="white", markersize=10, markeredgewidth=2.2)
        for panel in line[len(versions) :]:
            panel.set_visible(False)
        line[0].set_ylabel(TITLES.get(kind, kind), color=style.INK)
    return figure


def named(study: Study) -> Figure:
    """Draw how often each model names the true cause, with 95 % intervals, beside two image-blind rules."""
    table = study.table("summary.csv", finite=("right", "baseline_nearest_item"))
    users = [user for user in study.judged_users if user in set(table["user"])]
    figure, axes = panels(1, len(users), 6.0 * len(users), 1.3 + 0.42 * len(study.variants), sharey=True)
    for panel, user in zip(axes[0], users, strict=True):
        rows = table[table["user"] == user].reset_index(drop=True)
        for y, row in enumerate(rows.to_dict("records")):
            colour = style.colour(row["variant"])
            panel.hlines(y, 100 * row["ci_low"], 100 * row["ci_high"], color=colour, linewidth=2.5)
            panel.plot(100 * row["right"], y, style.marker(row["variant"]), color=colour, markersize=7)
        for column, line, name in (
            ("baseline_nearest_item", "--", "always the nearest item"),
            ("baseline_random_item", ":", "a random item"),
        ):
            panel.plot(100 * rows[column], rows.index, line, color=style.INK, label=name)
        panel.set_yticks(rows.index, [style.label(variant) for variant in rows["variant"]])
        panel.set(
            title=f"{user} user", xlabel="true cause named, per cent", xlim=(0, 103), ylim=(len(rows) - 0.5, -0.5)
        )
        panel.grid(axis="x")
    figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=10)
    return figure


def _answers(rows: pd.DataFrame, column: str) -> str:
    """Return P(valid) as text: a line for the truth and each shown model, a column for each user."""
    p = rows.pivot(index="variant", columns="user", values=column)
    lines = ["".join([" " * 9, *(f"{user[:7]:>8}" for user in p.columns)])]
    for name in (name for name in MODELS if name in p.index):
        lines.append(f"{MODELS[name]:9}" + "".join(f"{value:8.2f}" for value in p.loc[name]))
    return "\n".join(lines)
