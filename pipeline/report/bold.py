"""The paper's Table 2 with its bold cells, for pages, README, LaTeX and Markdown (`make tables`)."""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.artifacts.files import read_table
from pipeline.causal.interventions import NONE, PAPER, TRUTH
from pipeline.report.page import FORMATS, Table, in_brackets, lookup, with_gaps
from pipeline.report.style import label
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

BOLD, OUT = Path("reports/tables/bold.csv"), Path("tables")
NAMES = {PAPER: "The paper, as printed", TRUTH: "Truth in our world"}
COLUMNS = {NONE: "No intervention"}  # the symbols' columns have their own names
BEYOND = "†"
NOTES = (
    "Mean P(valid) of a random path, without and with an added item; in brackets quartiles over training sets, for the "
    "truth over scenes. Bold: a significant change against no intervention (Holm over the block's own changes, "
    "p < 0.05). †: the 95 % interval of the change also lies beyond ±0.05."
)


def wide(table: pd.DataFrame) -> pd.DataFrame:
    """Return bold.csv with a row per source and user, and for each change its mean, q1, q3, bold and beyond."""
    rows = []
    for (source, user), cells in table.groupby(["source", "user"], sort=False):
        row: dict[str, Any] = {"Source": NAMES.get(str(source)) or label(str(source)), "User": user}
        for cell in cells.itertuples():
            name, key = COLUMNS.get(str(cell.change), str(cell.change).capitalize()), {"source": source, "user": user}
            row[name] = lookup(table, "bold", "mean", **key, change=cell.change)
            row |= {f"{name}, {part}": getattr(cell, part) for part in ("q1", "q3", "bold", "beyond")}
        rows.append(row)
    return with_gaps(rows)


def bold_table(table: pd.DataFrame) -> Table:
    """Return the table of a page from bold.csv."""
    frame = wide(table)
    return Table(frame, {name: "rate" for name in frame if f"{name}, bold" in frame})


def as_markdown(table: pd.DataFrame, sources: Sequence[str] | None = None) -> str:
    """Return the table in Markdown, of these sources or of all."""
    return "\n".join(_lines(table, sources, lambda text, bold: f"**{text}**" if bold else text, "| {} |", " | ", True))


def as_latex(table: pd.DataFrame) -> str:
    """Return the table in LaTeX, for the package booktabs."""
    heads = len([name for name in wide(table) if ", " not in name])
    lines = _lines(table, None, lambda text, bold: rf"\textbf{{{text}}}" if bold else text, r"{} \\", " & ", False)
    begin, end = rf"\begin{{tabular}}{{@{{}}ll{'c' * (heads - 2)}@{{}}}}", r"\end{tabular}"
    body = "\n".join([begin, r"\toprule", lines[0], r"\midrule", *lines[1:], r"\bottomrule", end])
    for sign, command in (("%", r"\%"), ("β", r"$\beta$"), ("−", "$-$"), ("–", "--"), (BEYOND, r"\dag{}")):
        body = body.replace(sign, command)
    note = NOTES.replace("%", r"\%").replace("±", r"$\pm$").replace("<", "$<$").replace(BEYOND, r"\dag{}")
    return f"{body}\n% {note}\n"


def _lines(
    table: pd.DataFrame,
    sources: Sequence[str] | None,
    mark: Callable[[str, bool], str],
    line: str,
    between: str,
    ruled: bool,
) -> list[str]:
    frame = wide(table if sources is None else table[table["source"].isin(sources)])
    names = [str(name) for name in frame if ", " not in str(name)]
    lines = [line.format(between.join(names))] + ["| --- | --- |" + " --: |" * (len(names) - 2)] * ruled
    for row in frame.to_dict("records"):
        cells = [str(row["Source"]), str(row["User"]), *(_cell(row, name, mark) for name in names[2:])]
        lines.append(line.format(between.join(cells)))
    return lines


def _cell(row: Mapping[str, Any], name: str, mark: Callable[[str, bool], str]) -> str:
    write = FORMATS["rate"]
    if row[name] is None:
        return write(None)
    text = mark(write(float(row[name])), bool(row[f"{name}, bold"])) + BEYOND * bool(row[f"{name}, beyond"])
    return text + in_brackets(row, name, write)


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m pipeline.report.bold", description=__doc__).parse_args()
    try:
        results = read_table(BOLD)
        for name, text in {"bold.tex": as_latex(results), "bold.md": f"{as_markdown(results)}\n\n{NOTES}\n"}.items():
            atomic_write(OUT / name, lambda part, text=text: part.write_text(text, encoding="utf-8"))
            print(OUT / name)
    except InputError as error:
        sys.exit(f"error: {error}")
