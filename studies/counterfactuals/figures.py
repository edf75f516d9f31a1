"""Draw rejected paths on their table as it is and without each item."""

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
    """Draw a row for each example, with P(valid) by user below each table."""
    table, images = study.table("examples.csv"), study.arrays("examples.npz")
    kinds = list(dict.fromkeys(table["example"]))
    width = 1 + int(table.groupby("example")["slot"].nunique().max())
    figure, axes = panels(len(kinds), width, 3.3 * width, 4.6 * len(kinds), names=[TITLES[kind] for kind in kinds])
    for row, (line, kind) in enumerate(zip(axes, kinds, strict=True)):
        rows = table[table["example"] == kind]
        items = rows.drop_duplicates("slot").to_dict("records")
        versions = [("as it is", images["factual"][row], items[0]["slot"], "p")]
        versions += [
            (f"without this {i['symbol']}", images["without"][row][i["slot"]], i["slot"], "p_without") for i in items
        ]
        for panel, (title, image, slot, column) in zip(line, versions, strict=False):
            draw_table(panel, image)
            draw_path(panel, rows[["z_x", "z_y"]].iloc[0].to_numpy(float), style.START)
            panel.set_title(title)
            text = _answers(rows[rows["slot"] == slot], column)
            panel.set_xlabel(text, fontsize=14, family="DejaVu Sans Mono", loc="left")
        for panel, item in zip(line[1:], items, strict=False):
            panel.plot(item["x_m"], item["y_m"], "x", color="white", markersize=10, markeredgewidth=2.2)
        for panel in line[len(versions) :]:
            panel.set_visible(False)
    return figure


def _answers(rows: pd.DataFrame, column: str) -> str:
    """Return P(valid) as text: a line for the truth and each shown model, a column for each user."""
    p = rows.pivot(index="variant", columns="user", values=column)
    lines = ["".join([" " * 9, *(f"{user[:7]:>8}" for user in p.columns)])]
    shown = [name for name in MODELS if name in p.index]
    return "\n".join(lines + [f"{MODELS[v]:9}" + "".join(f"{value:8.2f}" for value in p.loc[v]) for v in shown])
