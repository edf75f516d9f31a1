"""What is left of each variant where users' rules are of another form, in numbers."""

from pipeline.report.results import AVERAGED, POSITION, Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import (
    NONE,
    believed_label,
    counted,
    form_label,
    listed,
    percent,
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
        for variant in [v for v in (*results.variants, AVERAGED, POSITION) if v in of["models"]]:
            cell = of["models"][variant]
            tally = of["verdicts"].get(variant)
            rows.append(
                [
                    rule, variant_label(variant), percent(cell["accuracy"]["mean"]),
                    NONE if form == OWN or variant == POSITION else _change(cell),
                    percent(cell["false_rejects"]), percent(cell["false_accepts"]),
                    NONE if variant == POSITION else percent(cell["demonstrations"]["mean"]),
                    NONE if tally is None else f"{tally['right']} of {tally['cells']}",
                ]
            )  # fmt: skip
    caption = (
        "Models fitted to the same demonstrations, labelled by rules of another form, and judged by those (of the "
        "paths that break a margin, the share that is forgiven): accuracy (mean over "
        f"{counted(found['seeds'], 'seed')}, {listed(found['users'])} users, {counted(found['scenes'], 'new scene')}); "
        "what the form adds to it, in percentage points (95 % intervals over seeds and scenes); valid paths rejected "
        "and invalid ones accepted; of the demonstrations it was taught by, the share that a model is right about; "
        "verdicts on added items that are right. Position only: told each control point's mean validity over all "
        "training scenes."
    )
    header = [
        "Rule", "Model", "Accuracy", "Change", "Valid rejected", "Invalid accepted", "Taught",
        "Verdicts right",
    ]  # fmt: skip
    return table("misspecification", caption, header, rows, labels=2)


def credence(results: Results) -> Table:
    """By form of the rule: how far the averaged models believe in each of theirs."""
    found = results.misspecification
    cells = {f: found["forms"][f]["credence"] for f in found["order"] if "credence" in found["forms"][f]}
    believed = list(next(iter(cells.values()), {"mean": {}})["mean"])
    rows: list[list[str | Cell]] = [
        [form_label(form), *(f"{c['mean'][b]:.2f} ({c['most'][b]}){'*' * (b == c['meant'])}" for b in believed)]
        for form, c in cells.items()
    ]
    caption = (
        "How far the path model averaged over forms believes in each of them, by the rule that labelled the "
        f"demonstrations: mean over {counted(found['seeds'], 'seed')} and {listed(found['users'])} users (in brackets, "
        "how many of the models believe in it most). With a star: the form that the rule has."
    )
    return table("credence", caption, ["Rule", *map(believed_label, believed)], rows)


def _change(cell: dict) -> str:
    low, high = (signed(100 * cell[name], 1) for name in ("ci_low", "ci_high"))
    return f"{signed(100 * cell['difference'], 1)} [{low}, {high}]"
