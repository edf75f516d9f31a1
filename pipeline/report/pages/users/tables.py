"""Users' margins, the paths that suit two of them, and the effects of a change of user."""

import pandas as pd

from pipeline.report.page import Table
from pipeline.report.pages.users.figures import pair
from pipeline.report.results import PAPER_TABLE_2, Results
from pipeline.report.slices import overlap as overlaps
from pipeline.report.style import label
from pipeline.world.layout import SYMBOLS

REACTS = ("full", "clearance")


def margins(results: Results) -> Table:
    """Return each user's margins, and the share of random paths valid to them: here and in the paper."""
    rows = []
    for user, rules in results.users.items():
        paper = PAPER_TABLE_2.loc[user, "none"] if user in PAPER_TABLE_2.index else None
        row = {"User": user} | {symbol: rules[symbol] for symbol in SYMBOLS}
        rows.append(row | {"Valid": results.value("p_valid", "truth", user=user, added="none"), "Valid, paper": paper})
    frame = pd.DataFrame(rows).astype(object)
    formats = dict.fromkeys(SYMBOLS, "cm") | dict.fromkeys(("Valid", "Valid, paper"), "pct")
    return Table(frame.where(frame.notna(), None), formats)


def overlap(results: Results) -> Table:
    """Return which test paths with unseen items are valid to two users, by the truth and by each shown model."""
    first, second = pair(results)
    frame = overlaps(results.tables["judged"], (first, second), "new_items")
    frame["source"] = frame["source"].map(lambda name: "Truth" if name == "truth" else label(name))
    names = {
        "source": "According to", "both": "Both", "first": f"{first} only", "second": f"{second} only",
        "neither": "Neither", "overlap_found": "Overlap found",
    }  # fmt: skip
    return Table(frame.rename(columns=names), dict.fromkeys(list(names.values())[1:], "pct"))


def reactions(results: Results) -> Table:
    """Return what each user reacts to: the true effect of each added item, and each model's, with its verdict."""
    asked = results.tables["interventions"]
    asked = asked[asked["kind"] == "add"]
    rows = []
    for user in results.users:
        for variant in ("truth", *(v for v in REACTS if v in results.variants)):
            mine = asked[
                (asked["user"] == user) & (asked["variant"] == (results.variants[0] if variant == "truth" else variant))
            ]
            column = "truth" if variant == "truth" else "effect"
            row = {"User": user, "According to": "Truth" if variant == "truth" else label(variant)}
            rows.append(row | {s: mine.loc[mine["symbol"] == s, column].iloc[0] for s in results.added_symbols})
    return Table(pd.DataFrame(rows), dict.fromkeys(results.added_symbols, "effect"))


def change_of_user(results: Results) -> Table:
    """Return the effect of do(S := other) for each user and other: the truth, and the shown models'."""
    asked = results.tables["interventions"]
    asked = asked[asked["kind"] == "user"]
    rows = []
    for (user, question), part in asked.groupby(["user", "question"], sort=False):
        part = part.set_index("variant")
        row = {"From": user, "To": str(question).removeprefix("another_user_"), "Truth": part["truth"].iloc[0]}
        rows.append(row | {label(v): part.loc[v, "effect"] for v in REACTS if v in part.index})
    frame = pd.DataFrame(rows)
    return Table(frame, dict.fromkeys(frame.columns[2:], "effect"))
