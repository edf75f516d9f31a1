"""Paths accepted with a promise, in numbers."""

from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import counted, listed, percent, percent_spread, rule_label, split_label, variant_label


def acceptance(results: Results) -> Table:
    """What every rule accepts, and how much of it is invalid, by variant and split."""
    found = results.acceptance
    rows: list[list[str | Cell]] = []
    for variant, split, by_rule in results.promises:
        for rule in found["rules"]:
            cell = by_rule[rule]
            interval = f"{100 * cell['ci_low']:.1f}–{100 * cell['ci_high']:.1f}"
            above, silent = (f"{cell[name]} of {cell['models']}" for name in ("above", "abstained"))
            invalid = [percent_spread(cell), interval, percent(cell["where_any"]), above]
            labels = [variant_label(variant), split_label(split), rule_label(rule)]
            rows.append([*labels, *invalid, percent(cell["power"]), silent])
    caption = (
        f"Paths accepted, mean over the users {listed(results.judged_users)}. The first two rules hold demonstrations "
        f"out and promise, or aim at, {percent(found['level'], 0)} invalid paths among those accepted at most. "
        "“Training scores” takes the demonstrations that the model was fitted to for held out, “P > 0.5” needs none, "
        "and “Told the truth” is the largest set above one threshold that keeps to it. Means and quartiles over "
        f"models, intervals over {counted(found['seeds'], 'seed')} crossed with "
        f"{counted(found['scenes'], 'scene')}; a model "
        "that accepts nothing counts as 0 %, but not under “models that accept any”, of which nothing is promised."
    )
    header = [
        "Model", "Judged on", "Rule", "Invalid among accepted", "95 % interval",
        "Invalid, models that accept any", "Above the promise",
        "Valid paths accepted", "Accept nothing",
    ]  # fmt: skip
    return table("acceptance", caption, header, rows, labels=3)
