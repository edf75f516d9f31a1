"""Every model at a glance, and the world they were fitted in."""

from pipeline.report.claims import free_right
from pipeline.report.results import POSITION, Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import (
    NONE,
    counted,
    listed,
    percent,
    variant_label,
)
from pipeline.table.layout import SYMBOLS


def models(results: Results) -> Table:
    """Every model at a glance: what it knows of new scenes, what its repairs and its verdicts are worth."""
    scores, anchor = results.evaluation["accuracy"], results.repair[results.main]
    few, many = f"n{min(results.ns)}", f"n{results.study_n}"
    repaired = [u for u in results.users if anchor[u]["success"] is not None]
    rows: list[list[str | Cell]] = []
    for v in results.variants:
        known, tally = scores[v]["new_items"], results.intervention["verdicts"][v]
        repairs = [results.search[v][u]["bayesian"] for u in repaired]
        rows.append(
            [
                variant_label(v), percent(known[few]["mean"]), percent(known[many]["mean"]),
                *(f"{percent(c['success'])} ({c['displacement_ratio']:.1f})" for c in repairs),
                f"{tally['right']} of {tally['cells']}",
            ]
        )  # fmt: skip
    known, nothing = scores[POSITION]["new_items"], [NONE for _ in repaired]
    free = f"{free_right(results)} of {results.intervention['verdicts'][results.main]['cells']}"
    rows.append([variant_label(POSITION), percent(known[few]["mean"]), percent(known[many]["mean"]), *nothing, free])
    detours = [anchor[u] for u in repaired]
    moved = [f"{percent(c['null_constant'])} ({c['null_constant_displacement_ratio']:.1f})" for c in detours]
    rows.append([variant_label("null_constant"), NONE, NONE, *moved, NONE])
    caption = (
        "Every model in new scenes with unseen items: accuracy (mean of the users "
        f"{listed(results.judged_users)}), success of repairs by a search that stays near the start (in brackets how "
        "far they move, over the least that would do, failures included) and causal verdicts that are right (a "
        "model that ignores the picture is right wherever there is no effect); means over "
        f"{counted(len(results.seeds), 'seed')}, "
        f"n = {results.study_n} unless said. The last rows never look at the image."
    )
    header = ["Model", f"Accuracy, n = {few[1:]}", f"Accuracy, n = {many[1:]}"]
    header += [f"Repaired, {u}" for u in repaired] + ["Verdicts right"]
    return table("models", caption, header, rows)


def world(results: Results) -> Table:
    """The simulated world's true P(valid) beside the paper's Table 2, to which it was calibrated."""
    rows: list[list[str | Cell]] = []
    for user in results.users:
        row: list[str | Cell] = [user.capitalize()]
        for symbol in ("none", *SYMBOLS):
            c = results.world["p_valid"][user][symbol]
            row.append(f"{c['truth']:.3f} ({NONE if c.get('paper') is None else format(c['paper'], '.2f')})")
        rows.append(row)
    caption = (
        "The simulated world: true share of random paths that are valid, the paper's Table 2 in brackets; "
        f"{counted(results.world['layouts'], 'scene')} of {counted(results.world['paths'], 'path')} each."
    )
    return table("world", caption, ["User", "No intervention", *(s.capitalize() for s in SYMBOLS)], rows)
