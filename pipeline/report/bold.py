"""The paper's Table 2 with its bold cells, for pages, README, LaTeX and Markdown (`make tables`)."""

import argparse
import sys
from pathlib import Path
from typing import Any

import pandas as pd

from pipeline.artifacts.files import read_table
from pipeline.causal.bold_table import NONE, PAPER, TRUTH
from pipeline.report.style import label
from pipeline.report.tables import FORMATS, HIDDEN, in_brackets, rows_of
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

BOLD, OUT = Path("reports/tables/bold.csv"), Path("tables")
NAMES = {PAPER: "The paper, as printed", TRUTH: "Truth in our world"}
BEYOND = "†"
NOTES = (
    "Mean P(valid) of a random path, without and with an added item; in brackets quartiles over training sets, for the "
    "truth over scenes. Bold: a significant change against no intervention (Holm over the block's own changes, "
    "p < 0.05). †: the 95 % interval of the change also lies beyond ±0.05."
)
SHOWN: dict[str, Any] = {  # how `rows_of` shows bold.csv: a row for each source and user
    "columns": {"source": "Source", "user": "User", "mean": ""},
    "across": "change",
    "words": {
        "source": lambda name: NAMES.get(name) or label(name),
        "change": lambda name: "No intervention" if name == NONE else name.capitalize(),
    },
    "formats": {"": "rate"},
    "quartiles": True,
    "bold": "bold",
    "beyond": "beyond",
}


def cells(table: pd.DataFrame, bold: str) -> list[list[str]]:
    """Return bold.csv's titles and rows as text; `bold` is the pattern of a bold number."""
    frame, write = rows_of(None, lambda _: table, **SHOWN).frame, FORMATS["rate"]
    names = [name for name in frame if not str(name).endswith(HIDDEN)]
    lines = [list(map(str, names))]
    for row in frame.to_dict("records"):
        line = [row["Source"], row["User"]]
        for name in names[2:]:
            text = (bold if row[f"{name}, bold"] else "{}").format(write(float(row[name])))
            line.append(text + BEYOND * bool(row[f"{name}, beyond"]) + in_brackets(row, str(name), write))
        lines.append(line)
    return lines


def as_markdown(table: pd.DataFrame) -> str:
    """Return the table in Markdown."""
    head, *lines = cells(table, "**{}**")
    rule = ["---", "---", *["--:"] * (len(head) - 2)]
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, rule, *lines))


def as_latex(table: pd.DataFrame) -> str:
    """Return the table in LaTeX, for the package booktabs."""
    head, *lines = (rf"{' & '.join(line)} \\" for line in cells(table, r"\textbf{{{}}}"))
    columns = table["change"].nunique()
    begin, end = rf"\begin{{tabular}}{{@{{}}ll{'c' * columns}@{{}}}}", r"\end{tabular}"
    body = "\n".join([begin, r"\toprule", head, r"\midrule", *lines, r"\bottomrule", end])
    for sign, command in (("%", r"\%"), ("β", r"$\beta$"), ("−", "$-$"), ("–", "--"), (BEYOND, r"\dag{}")):
        body = body.replace(sign, command)
    note = NOTES.replace("%", r"\%").replace("±", r"$\pm$").replace("<", "$<$").replace(BEYOND, r"\dag{}")
    return f"{body}\n% {note}\n"


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m pipeline.report.bold", description=__doc__).parse_args()
    try:
        results = read_table(BOLD)
        for name, text in {"bold.tex": as_latex(results), "bold.md": f"{as_markdown(results)}\n\n{NOTES}\n"}.items():
            atomic_write(OUT / name, lambda part, text=text: part.write_text(text, encoding="utf-8"))
            print(OUT / name)
    except InputError as error:
        sys.exit(f"error: {error}")
