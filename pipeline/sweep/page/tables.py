"""Tables of a sweep's page."""

import pandas as pd

from pipeline.report.page import Table, with_gaps
from pipeline.report.style import label
from pipeline.sweep.results import LOWER_IS_BETTER
from pipeline.sweep.summary import Summary

RATES = ("accuracy", "repair")  # shown in per cent, differences in points
WORDS = {"better": "better", "worse": "worse", "same": "same within 1 point", "undecided": "undecided"}
MAX_SHOWN = 4  # headlines beside one another in a table
KINDS = {"accuracy_one_demo": "accuracy with one demonstration", "effect_error": "largest effect error"}
DIFFERENCE = ["Difference", "95 %, from", "to"]


def title(headline: str) -> str:
    """Return a headline in words: accuracy.full.new_items as Accuracy, paper's model, unseen items."""
    kind, *rest = headline.split(".")
    text = ", ".join([KINDS.get(kind, kind.replace("_", " ")), *(label(part) for part in rest)])
    return text[:1].upper() + text[1:]


def best(summary: Summary) -> list[dict]:
    """Return a row for each changed headline: the best setting, its mean, the reference's, and their difference."""
    rows = []
    for headline in summary.headlines:
        means = summary.means[summary.means["headline"] == headline].set_index("setting")["mean"]
        setting = means.idxmin() if headline.startswith(LOWER_IS_BETTER) else means.idxmax()
        row = {"headline": headline, "setting": setting, "mean": means[setting], "reference": means[summary.reference]}
        test = summary.differences.query("headline == @headline and setting == @setting")
        rows.append(row | (test.iloc[0].to_dict() if len(test) else {"word": "reference"}))
    return rows


def verdicts(summary: Summary) -> Table:
    """Return the best setting by headline, and whether it differs from the reference."""
    rows = [
        {
            "Result": title(row["headline"]),
            "Reference": row["reference"],
            "Best setting": row["setting"],
            "Its mean": row["mean"],
            "Difference": row.get("difference"),
            "95 %, from": row.get("ci_low"),
            "to": row.get("ci_high"),
            "p (Holm)": row.get("p_holm"),
            "Than the reference": WORDS.get(row["word"], "is the reference"),
        }
        for row in best(summary)
    ]
    return Table(with_gaps(rows), dict.fromkeys(["Reference", "Its mean", *DIFFERENCE], "fine") | {"p (Holm)": "fine"})


def settings(summary: Summary) -> Table:
    """Return the mean and quartiles over seeds of the first changed headlines, a row a setting."""
    rows = []
    for setting, part in summary.means.groupby("setting", sort=False):
        row: dict[str, object] = {"Setting": setting}
        for headline in summary.headlines[:MAX_SHOWN]:
            cell = part[part["headline"] == headline]
            for end, column in (("", "mean"), (", q1", "q1"), (", q3", "q3")):
                row[title(headline) + end] = float(cell[column].iloc[0]) if len(cell) else None
        rows.append(row)
    frame = with_gaps(rows)
    formats = {c: "pct1" if str(c).lower().startswith(RATES) else "fine" for c in frame.columns[1:]}
    return Table(frame, formats)


def differences(summary: Summary) -> Table:
    """Return every paired difference from the reference."""
    shown = summary.differences
    frame = pd.DataFrame(
        {
            "Result": shown["headline"].map(title),
            "Setting": shown["setting"],
            "Difference": shown["difference"],
            "95 %, from": shown["ci_low"],
            "to": shown["ci_high"],
            "p (Holm)": shown["p_holm"],
            "Seeds": shown["seeds"],
            "Than the reference": shown["word"].map(WORDS),
        }
    )
    return Table(with_gaps(frame), dict.fromkeys(DIFFERENCE, "fine") | {"p (Holm)": "fine", "Seeds": "count"})


def comparisons(summary: Summary) -> Table:
    """Return every comparison of variants within a setting."""
    shown = summary.comparisons
    frame = pd.DataFrame(
        {
            "Setting": shown["setting"],
            "Model": shown["variant"].map(label),
            "Against": shown["against"].map(label),
            "On": shown["split"].map(label),
            "Accuracy": shown["after"],
            "Of the other": shown["before"],
            "Difference": shown["difference"],
            "95 %, from": shown["ci_low"],
            "to": shown["ci_high"],
            "p (Holm)": shown["p_holm"],
            "Than the other": shown["word"].map(WORDS),
        }
    )
    formats = dict.fromkeys(["Accuracy", "Of the other"], "pct1") | dict.fromkeys(DIFFERENCE, "points1")
    return Table(with_gaps(frame), formats | {"p (Holm)": "fine"})


def broken(summary: Summary) -> Table:
    """Return the jobs without a result."""
    rows = [
        {"Job": j["name"], "State": j["state"], "Why": j.get("error", "")} for j in summary.jobs if j["state"] != "done"
    ]
    return Table(with_gaps(rows))
