"""Copy the headlines of reports/metrics.json into the README: `python -m pipeline.report.readme` or `make readme`."""

import argparse
import re
import sys

import pandas as pd

from pipeline.artifacts.files import read_json, read_table
from pipeline.config.graph import ROOT
from pipeline.report.page import FORMATS
from pipeline.report.style import COLOURS, label
from pipeline.runtime.errors import InputError

README, METRICS, VERDICTS = (
    ROOT / name for name in ("README.md", "reports/metrics.json", "reports/tables/causes-verdicts.csv")
)
HEAD = "| Model | Accuracy, unseen items | Repairs, careful | Repairs, normal | Causal verdicts right |"


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


def _share(value: float | None) -> str:
    """Return a share in per cent, with a decimal where it would else read as all."""
    return FORMATS["pct1" if value is not None and 0.995 <= value < 1 else "pct"](value)


def fill(text: str, table: str) -> str:
    """Return the README's text with the table between its markers."""
    return re.sub(
        r"(<!-- headlines -->\n).*?(<!-- /headlines -->)", lambda m: f"{m[1]}\n{table}\n\n{m[2]}", text, flags=re.DOTALL
    )


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m pipeline.report.readme", description=__doc__).parse_args()
    try:
        README.write_text(fill(README.read_text(), headlines(read_json(METRICS), read_table(VERDICTS))))
    except InputError as error:
        sys.exit(f"error: {error}")
