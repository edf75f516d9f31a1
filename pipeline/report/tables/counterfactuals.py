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
                    _number(c["pn_error"]), _number(c["ps_error"]), _cm(move.get("error_m")),
                ]
            )  # fmt: skip
    found = results.counterfactual
    caption = (
        f"Unit counterfactuals in {counted(found['scenes'], 'scene')} of {counted(found['paths'], 'path')}. Rejected: "
        "truly invalid paths that the model rejects. Of those: the right one of a single culprit blamed [95 % "
        "interval]; the same by blaming the nearest item; several culprits recognised as such; rejected on an empty "
        "table as well. PN and PS: mean absolute error of the probabilities of necessity and sufficiency. Move: mean "
        "error of the least move of the culprit that would make the path valid [cm]. "
        f"{counted(found['seeds'], 'seed')}."
    )
    header = ["User", "Model", "Rejected", "Blame right", "Nearest", "Several", "Empty table", "PN", "PS", "Move"]
    return table("blame", caption, header, rows, labels=2)


def _number(value: float | None) -> str:
    return NONE if value is None else f"{value:.3f}"


def _cm(length: float | None) -> str:
    return NONE if length is None else f"{100 * length:.1f}"
