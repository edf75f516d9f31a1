"""Tables of the pages for the README and for papers: `python -m pipeline.report.exports readme` or `tables`."""

import argparse
import re
from collections.abc import Mapping
from itertools import product
from pathlib import Path

import pandas as pd

from pipeline.artifacts.files import read_json, read_table
from pipeline.causal.interventions import PAPER, TRUTH, bold_or_plain
from pipeline.report.derived import TABLE_2
from pipeline.report.results import PAPER_ACCURACY, RANDOM_ROUTES
from pipeline.report.style import COLOURS, label
from pipeline.report.tables import FORMATS, HIDDEN, in_brackets, rows_of
from pipeline.runtime.errors import reported
from pipeline.runtime.places import ROOT
from pipeline.runtime.writing import atomic_write

REPORTS = Path("reports")
README = ROOT / "README.md"
HEAD = ["Model", "Accuracy, unseen items", "Repairs, careful", "Repairs, normal", "Causal verdicts right"]
NOTES = (
    "Mean P(valid) of a random path, without and with an added item; in brackets quartiles over training sets, for the "
    "truth over scenes. Bold: a significant change against no intervention (Holm over the block's own changes, "
    "p < 0.05). †: the 95 % interval of the change also lies beyond ±0.05."
)


def contents(repository: Path) -> dict[str, str]:
    """Return what stands between each pair of the README's markers, from the reports of a repository.

    Raise InputError for a file that is missing or cannot be read.
    """
    tables = repository / REPORTS / "tables"
    table_2, metrics = read_table(tables / "bold.csv"), read_json(repository / REPORTS / "metrics.json")
    shown = table_2[table_2["source"].isin((PAPER, TRUTH, "full", "clearance"))]
    return {
        "headlines": headlines(metrics, read_table(tables / "causes-verdicts.csv")),
        "curve": curve(read_table(tables / "curve.csv")),
        "bold": f"{as_markdown(shown)}\n\n{bold_or_plain(table_2)}",
    }


def headlines(metrics: dict, verdicts: pd.DataFrame) -> str:
    """Return the headlines as a markdown table: one row per variant or baseline, a dash for missing numbers.

    `verdicts`: the report's table with a row per model and question.
    """
    questions, rows = verdicts["Model"].value_counts().max(), []
    order = [*COLOURS, *metrics["verdicts_right"]]  # the paper's model first, added variants last
    for name in [*sorted(metrics["verdicts_right"], key=order.index), "position_only", "constant_detour"]:
        repairs = [metrics["repair"].get(name, {}).get(user) for user in ("careful", "normal")]
        shares = [FORMATS["pct"](value) for value in (metrics["accuracy"].get(name, {}).get("new_items"), *repairs)]
        right = metrics["verdicts_right"].get(name)
        rows.append([label(name), *shares, "–" if right is None else f"{right} of {questions}"])
    return _markdown(HEAD, rows)


def curve(table: pd.DataFrame) -> str:
    """Return accuracy at both ends of the paper's curve as a markdown table, means of the paper's users."""
    ends = sorted(PAPER_ACCURACY)
    rows = [[label("paper"), *(_spread(*PAPER_ACCURACY[n]) for n in ends)]]
    table = table[table["users"] == "paper"].set_index(["split", "reading", "variant", "n_demos"])[["mean", "q1", "q3"]]
    readings = sorted(dict.fromkeys(table.index.get_level_values("reading")), key=lambda name: name == RANDOM_ROUTES)
    lines = {"held_out": ("full", "nearest_demonstration"), "new_items": ("full", "position_only")}
    for (split, variants), reading in product(lines.items(), readings):
        for variant in variants:
            keys = [(split, reading, variant, n) for n in ends]
            if all(key in table.index for key in keys):
                where = "" if split == "held_out" else "new tables, "
                cells = [_spread(*numbers) for numbers in table.loc[keys].to_numpy()]
                rows.append([f"{label(variant)}, {where}{label(reading)}", *cells])
    return _markdown(["Demonstrations a table", *map(str, ends)], rows)


def _spread(mean: float, low: float, high: float) -> str:
    return f"{FORMATS['pct'](mean)} [{FORMATS['spread'](low, high)}]"


def _markdown(head: list[str], rows: list[list[str]], texts: int = 1) -> str:
    """Return a table in Markdown; the first columns are texts."""
    rule = ["---"] * texts + ["--:"] * (len(head) - texts)
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, rule, *rows))


def fill(text: str, parts: Mapping[str, str]) -> str:
    """Return the README's text with each part between its markers."""
    for name, part in parts.items():
        between = re.compile(rf"(?<=<!-- {name} -->\n).*?(?=<!-- /{name} -->)", re.DOTALL)
        text = between.sub(lambda _, part=part: f"\n{part}\n\n", text)
    return text


def _table_2(table: pd.DataFrame, bold: str) -> tuple[list[str], list[list[str]]]:
    """Return bold.csv's titles and rows as text; `bold` is the pattern of a bold number."""
    frame, write = rows_of(None, lambda _: table, **TABLE_2)[0], FORMATS["rate"]
    names, lines = [str(name) for name in frame if not str(name).endswith(HIDDEN)], []
    for row in frame.to_dict("records"):
        line = [row["Source"], row["User"]]
        for name in names[2:]:
            number = write(None if row[name] is None else float(row[name]))
            text = (bold if row[f"{name}, bold"] else "{}").format(number)
            line.append(text + "†" * bool(row[f"{name}, beyond"]) + in_brackets(row, name, write))
        lines.append(line)
    return names, lines


def as_markdown(table: pd.DataFrame) -> str:
    """Return the paper's Table 2 with its bold cells in Markdown."""
    return _markdown(*_table_2(table, "**{}**"), texts=2)


def as_latex(table: pd.DataFrame) -> str:
    """Return the paper's Table 2 with its bold cells in LaTeX, for the package booktabs."""
    names, rows = _table_2(table, r"\textbf{{{}}}")
    head, *lines = (rf"{' & '.join(line)} \\" for line in (names, *rows))
    begin = rf"\begin{{tabular}}{{@{{}}ll{'c' * (len(names) - 2)}@{{}}}}"
    body = "\n".join([begin, r"\toprule", head, r"\midrule", *lines, r"\bottomrule", r"\end{tabular}"])
    body = body.replace("–", "--") + "\n% " + NOTES.replace("<", "$<$") + "\n"
    for sign, command in (("β", r"$\beta$"), ("−", "$-$"), ("±", r"$\pm$"), ("†", r"\dag{}"), ("_", r"\_")):
        body = body.replace(sign, command)
    return re.sub(r"(?<!\n)%", r"\\%", body)


def main(form: str) -> None:
    """Write README.md, or tables/bold.tex and .md, from reports/."""
    if form == "readme":
        texts = {README: fill(README.read_text(encoding="utf-8"), contents(ROOT))}
    else:
        bold = read_table(REPORTS / "tables" / "bold.csv")
        texts = {Path("tables/bold.tex"): as_latex(bold), Path("tables/bold.md"): f"{as_markdown(bold)}\n\n{NOTES}\n"}
    for path, text in texts.items():
        atomic_write(path, lambda part, text=text: part.write_text(text, encoding="utf-8"))
        print(path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m pipeline.report.exports", description=__doc__)
    parser.add_argument("form", choices=["readme", "tables"])
    with reported():
        main(parser.parse_args().form)
