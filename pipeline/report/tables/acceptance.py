"""Paths accepted with a promise, in numbers."""

from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import counted, listed, percent, percent_spread, rule_label, split_label, variant_label


def acceptance(results: Results) -> Table:
    """Every rule, the mean over users."""
    rows = [[*labels, *_numbers(cell)] for labels, cell in _cells(results)]
    caption = f"Paths accepted, mean over the users {listed(results.judged_users)}. {_caption(results)}"
    return table("acceptance", caption, ["Model", "Judged on", "Rule", *_HEADER], rows, labels=3)


def acceptance_by_user(results: Results) -> Table:
    """The same by user."""
    rows = [
        [*labels, user.capitalize(), *_numbers(of_user)]
        for labels, cell in _cells(results)
        for user, of_user in cell["users"].items()
    ]
    caption = f"Paths accepted, by user. {_caption(results)}"
    return table("acceptance_by_user", caption, ["Model", "Judged on", "Rule", "User", *_HEADER], rows, labels=4)


_HEADER = [
    "Invalid among accepted", "95 % interval", "Where any is accepted", "Above the promise", "Valid paths accepted",
    "Accept nothing",
]  # fmt: skip


def _cells(results: Results) -> list[tuple[list[str | Cell], dict]]:
    """A row's labels and its numbers."""
    found = results.acceptance
    return [
        ([variant_label(variant), split_label(split), rule_label(rule)], by_rule[rule])
        for variant, by_split in found["acceptance"].items()
        for split, by_rule in by_split.items()
        for rule in found["rules"]
    ]


def _numbers(cell: dict) -> list[str | Cell]:
    interval = f"{100 * cell['ci_low']:.1f}–{100 * cell['ci_high']:.1f}"
    of = f"of {cell['models']}"
    return [
        percent_spread(cell), interval, percent(cell["where_any"]), f"{cell['above']} {of}", percent(cell["power"]),
        f"{cell['abstained']} {of}",
    ]  # fmt: skip


def _caption(results: Results) -> str:
    found = results.acceptance
    return (
        f"The first two rules hold demonstrations out and promise, or aim at, {percent(found['level'], 0)} invalid "
        "paths among those accepted at most; the last is the largest set above one threshold that keeps to it. Means "
        f"and quartiles over models, intervals over {counted(found['seeds'], 'seed')} crossed with "
        f"{counted(found['scenes'], 'scene')}; a model that accepts nothing counts as 0 %, but not "
        "under “where any is accepted”, of which nothing is promised."
    )
