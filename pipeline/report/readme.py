"""Copy the results into the README: `python -m pipeline.report.readme` or `make readme`."""

import argparse
import re
import sys
from collections.abc import Mapping
from itertools import product
from pathlib import Path

import pandas as pd

from pipeline.artifacts.files import read_json, read_table
from pipeline.causal.bold_table import PAPER, TRUTH, never_bold
from pipeline.report.bold import as_markdown
from pipeline.report.results import PAPER_ACCURACY, RANDOM_ROUTES
from pipeline.report.style import COLOURS, label
from pipeline.report.tables import FORMATS
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT

README = ROOT / "README.md"
HEAD = "| Model | Accuracy, unseen items | Repairs, careful | Repairs, normal | Causal verdicts right |"
BOLD_SOURCES = (PAPER, TRUTH, "full", "clearance")


def contents(repository: Path) -> dict[str, str]:
    """Return what stands between each pair of the README's markers, from the reports of a repository.

    Raise InputError for a file that is missing or cannot be read.
    """
    reports = repository / "reports"
    metrics, tables = read_json(reports / "metrics.json"), reports / "tables"
    bold = read_table(tables / "bold.csv")
    blind = f"A model that never sees the image has nothing bold: {never_bold(bold)} as in the paper."
    return {
        "headlines": headlines(metrics, read_table(tables / "causes-verdicts.csv")),
        "curve": curve(read_table(tables / "curve.csv")),
        "bold": f"{as_markdown(bold[bold['source'].isin(BOLD_SOURCES)])}\n\n{blind}",
    }


def headlines(metrics: dict, verdicts: pd.DataFrame) -> str:
    """Return the headlines as a markdown table: one row per variant or baseline, a dash for missing numbers.

    `verdicts`: the report's table with a row per model and question.
    """
    questions = verdicts["Model"].value_counts().max()
    rows = [HEAD, "| --- | --: | --: | --: | --: |"]
    order = [*COLOURS, *metrics["verdicts_right"]]  # the paper's model first, added variants last
    for name in [*sorted(metrics["verdicts_right"], key=order.index), "position_only", "constant_detour"]:
        accuracy = metrics["accuracy"].get(name, {}).get("new_items")
        repairs = [metrics["repair"].get(name, {}).get(user) for user in ("careful", "normal")]
        right = metrics["verdicts_right"].get(name)
        cells = [label(name), *map(_share, (accuracy, *repairs)), "–" if right is None else f"{right} of {questions}"]
        rows.append("| " + " | ".join(cells) + " |")
    return "\n".join(rows)


def curve(table: pd.DataFrame) -> str:
    """Return accuracy at both ends of the paper's curve as a markdown table, means of the paper's users."""
    ends = sorted(PAPER_ACCURACY)
    rows = ["| Demonstrations a table | " + " | ".join(map(str, ends)) + " |", "| --- |" + " --: |" * len(ends)]
    cells = [_share(PAPER_ACCURACY[n][0]) + _quartiles(*PAPER_ACCURACY[n][1:]) for n in ends]
    rows.append(f"| {label('paper')} | " + " | ".join(cells) + " |")
    table = table[table["users"] == "paper"].set_index(["split", "reading", "variant", "n_demos"])[["mean", "q1", "q3"]]
    readings = sorted(dict.fromkeys(table.index.get_level_values("reading")), key=lambda name: name == RANDOM_ROUTES)
    lines = {"held_out": ("full", "nearest_demonstration"), "new_scenes": ("full", "position_only")}
    for (split, variants), reading in product(lines.items(), readings):
        for variant in variants:
            keys = [(split, reading, variant, n) for n in ends]
            if all(key in table.index for key in keys):
                cells = [_share(mean) + _quartiles(q1, q3) for mean, q1, q3 in table.loc[keys].to_numpy()]
                where = "" if split == "held_out" else "new tables, "
                rows.append(f"| {label(variant)}, {where}{label(reading)} | " + " | ".join(cells) + " |")
    return "\n".join(rows)


def _quartiles(low: float, high: float) -> str:
    return f" [{FORMATS['spread'](low, high)}]"


def _share(value: float | None) -> str:
    """Return a share in per cent, with a decimal where it would else read as all."""
    return FORMATS["pct1" if value is not None and 0.995 <= value < 1 else "pct"](value)


def fill(text: str, parts: Mapping[str, str]) -> str:
    """Return the README's text with each part between its markers."""
    for name, part in parts.items():
        text = re.sub(
            rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)",
            lambda m, part=part: f"{m[1]}\n{part}\n\n{m[2]}",
            text,
            flags=re.DOTALL,
        )
    return text


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m pipeline.report.readme", description=__doc__).parse_args()
    try:
        README.write_text(fill(README.read_text(encoding="utf-8"), contents(ROOT)), encoding="utf-8")
    except InputError as error:
        sys.exit(f"error: {error}")
