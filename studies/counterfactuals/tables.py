"""The item that each model names, and how far it would have to move."""

from pipeline.report import style
from pipeline.report.study import Study
from pipeline.report.tables import Table, pick, with_gaps


def attributions(study: Study) -> Table:
    """Return how often each model names the true cause of a rejection, beside image-blind rules.

    Intervals are None where there are too few cases for one.
    """
    table = study.table("summary.csv", finite=("right", "baseline_nearest_item"))
    titles = {
        "user": "User", "variant": "Model", "right": "Right", "ci_low": "low", "ci_high": "high",
        "baseline_nearest_item": "Nearest item", "baseline_random_item": "Random item",
        "empty_rejected": "Rejects the empty table",
    }  # fmt: skip
    table = table.sort_values("user", key=lambda users: users.map(study.judged_users.index), kind="stable")
    frame = with_gaps(pick(table, titles, variant=style.label))
    return Table(frame, dict.fromkeys(frame.columns[2:], "pct1"))


def moves(study: Study) -> Table:
    """Return how often a move of the responsible item is found, and its error, in cases that the model rejects.

    Shares of moves found, errors and intervals are None where there are too few cases.
    """
    table = study.table("moves.csv", finite=("true_m", "rejected"))
    shares = {"found": "Move found", "found_ci_low": "found low", "found_ci_high": "found high"}
    lengths = {"error_m": "Error", "error_m_ci_low": "error low", "error_m_ci_high": "error high"}
    lengths |= {"constant_error_m": "Error of a constant"}
    titles = {"user": "User", "variant": "Model", "rejected": "Rejected"} | shares | lengths
    formats = dict.fromkeys(("Rejected", *shares.values()), "pct") | dict.fromkeys(lengths.values(), "cm")
    return Table(with_gaps(pick(table, titles, variant=style.label)), formats)
