"""Which item is to blame for a rejected path, by every model."""

from pipeline.report.results import Results
from pipeline.report.table import Cell, Table, table
from pipeline.report.wording import NONE, counted, percent, percent_spread, variant_label


def blame(results: Results) -> Table:
    """Who blames the right item, and how far the probabilities and the least moves are from the true ones."""
    rows: list[list[str | Cell]] = []
    for user in results.users:
        for variant in results.variants:
            c = results.counterfactual["counterfactual"][variant][user]
            if c is None:
                continue
            move = c["least_move"] or {}  # none where too few cases could be moved
            right = percent_spread(c, "blame_right", "ci_low", "ci_high") if c["ci_low"] is not None else NONE
            rows.append(
                [
                    user.capitalize(), variant_label(variant), percent(c["recall"]), right,
                    percent(c["null_nearest"]), percent(c["several_right"]), percent(c["empty_rejected"]),
                    _beside(c["pn_error"], c["pn_null"]), _beside(c["ps_error"], c["ps_null"]), _moved(move),
                ]
            )  # fmt: skip
    found = results.counterfactual
    caption = (
        f"Unit counterfactuals in {counted(found['scenes'], 'scene')} of {counted(found['paths'], 'path')}. Rejected: "
        "truly invalid paths that the model rejects. Of those: the right one of a single culprit blamed [95 % "
        "interval]; the same by blaming the nearest item; several culprits recognised as such; rejected on an empty "
        "table as well. PN and PS: mean absolute error of the probabilities of necessity and sufficiency (of the best "
        "constant). Move: mean error [cm] of the least move of the culprit that would make the path valid (of the best "
        f"constant), where one was found: share of {_cases(results)} paths a user. "
        f"{counted(found['seeds'], 'seed')}."
    )
    header = ["User", "Model", "Rejected", "Blame right", "Nearest", "Several", "Empty table", "PN", "PS", "Move"]
    return table("blame", caption, header, rows, labels=2)


def _cases(results: Results) -> int:
    """Paths a user whose culprit was moved, at most."""
    cells = [c for by in results.counterfactual["counterfactual"].values() for c in by.values() if c is not None]
    return max((c["least_move"]["cases"] for c in cells if c["least_move"]), default=0)


def _beside(error: float | None, null: float | None) -> str:
    return NONE if error is None or null is None else f"{error:.3f} ({null:.3f})"


def _moved(move: dict) -> str:
    if move.get("error_m") is None:
        return NONE
    return f"{100 * move['error_m']:.1f} ({100 * move['null_error_m']:.1f}), {percent(move['found'], 0)}"
