"""Whether the models blame the right item for a path they reject."""

from pipeline.report.results import Results
from pipeline.report.wording import interval, listed, percent, variant_phrase


def counterfactuals(results: Results) -> list[str]:
    """Blame by model and user, beside its nulls; what the probabilities and the least moves are worth."""
    cells = results.counterfactual["counterfactual"]
    users = results.rejecting
    best = results.best_blamer
    out = [_blame(cells[best], best, users)]
    if best != results.main:
        out.append(_blame(cells[results.main], results.main, users))
    empty = {v: [c["empty_rejected"] for u in users if (c := cells[v][u])] for v in results.variants}
    blind = [variant_phrase(v) for v, shares in empty.items() if shares and min(shares) > 0.5]
    if blind:
        out.append(
            f"On an empty table {listed(blind)} would reject more than half of these paths as well: no item is the "
            "reason, so asking which one is to blame has no answer."
        )
    moves = {u: c["least_move"] for u in users if (c := cells[best][u])}
    said = [
        f"{100 * m['error_m']:.1f} cm for the {u} user (the best constant by {100 * m['null_error_m']:.1f}, of "
        f"{100 * m['true_m']:.1f} on average; {m['cases']} paths, a move found for {percent(m['found'], 0)})"
        for u, m in moves.items()
        if m and m["error_m"] is not None
    ]
    if said:
        out.append(
            f"The least move of the culprit that would make the path valid, as {variant_phrase(best)} sees it, is off "
            f"by {listed(said)}."
        )
    return out


def _blame(cells: dict, variant: str, users: list[str]) -> str:
    parts = []
    for user in users:
        c = cells[user]
        if c is None or c["blame_right"] is None:
            continue
        spread = "" if c["ci_low"] is None else f"{interval(c)}; "
        parts.append(
            f"{percent(c['blame_right'])} for the {user} user ({spread}any item {percent(c['null_random'])}, the "
            f"nearest {percent(c['null_nearest'])}; it rejects {percent(c['recall'])} of the invalid paths)"
        )
    name = variant_phrase(variant)
    if not parts:
        return f"No path that a single item forbids is rejected by {name}."
    return f"Where a single item forbids a path that {name} rejects, it blames the right one in {listed(parts)}."
