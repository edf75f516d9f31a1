"""What is left of each variant where users' rules are of another form, in numbers."""

from pipeline.report.results import POSITION, Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import (
    NONE,
    counted,
    form_label,
    listed,
    percent,
    percent_spread,
    signed,
    variant_label,
)
from pipeline.table.forms import OWN


def misspecification(results: Results) -> Table:
    """By form and variant: accuracy, what the form takes from it, and verdicts that are right."""
    found = results.misspecification
    rows: list[list[str | Cell]] = []
    for form in found["order"]:
        of = found["forms"][form]
        rule = form_label(form) if form == OWN else f"{form_label(form)} ({percent(of['forgiven'], 0)})"
        for variant in [v for v in (*results.variants, POSITION) if v in of["models"]]:
            cell = of["models"][variant]
            tally = of["verdicts"].get(variant)
            rows.append(
                [
                    rule, variant_label(variant), percent_spread(cell["accuracy"]),
                    NONE if form == OWN or variant == POSITION else _change(cell),
                    percent(cell["false_rejects"]), percent(cell["false_accepts"]),
                    NONE if variant == POSITION else percent(cell["demonstrations"]["mean"]),
                    NONE if tally is None else f"{tally['right']} of {tally['cells']}",
                    NONE if tally is None else f"{tally['false_causes']}, {tally['missed_causes']}",
                ]
            )  # fmt: skip
    caption = (
        "Models fitted to the same demonstrations, labelled by rules of another form, and judged by those (of the "
        "paths that break a margin, the share that is forgiven): accuracy (mean and quartiles over "
        f"{counted(found['seeds'], 'seed')}, {listed(found['users'])} users, {counted(found['scenes'], 'new scene')}); "
        "what the form adds to it, in percentage points (95 % intervals over seeds and scenes); valid paths rejected "
        "and invalid ones accepted; of the demonstrations it was taught by, the share that a model is right about; "
        "verdicts on added items that are right, and false and missed causes. Position only: told each control "
        "point's mean validity over all training scenes."
    )
    header = [
        "Rule", "Model", "Accuracy", "Change", "Valid rejected", "Invalid accepted", "Taught", "Verdicts right",
        "False, missed",
    ]  # fmt: skip
    return table("misspecification", caption, header, rows, labels=2)


def _change(cell: dict) -> str:
    low, high = (signed(100 * cell[name], 1) for name in ("ci_low", "ci_high"))
    return f"{signed(100 * cell['difference'], 1)} [{low}, {high}]"
