"""Users' margins, the paths that suit two of them, and the effects of a change of user."""

import numpy as np
import pandas as pd

from pipeline.report.page import Table, pick, with_gaps
from pipeline.report.pages.users.figures import pair
from pipeline.report.results import PAPER_TABLE_2, Results
from pipeline.report.slices import overlap as overlaps
from pipeline.report.style import label
from pipeline.world.layout import SYMBOLS

REACTS = ("full", "clearance")
ENDS = ("q1", "q3")


def margins(results: Results) -> Table:
    """Return each user's margins, and the share of random paths valid to them: here and in the paper."""
    rows = []
    for user, rules in results.users.items():
        paper = PAPER_TABLE_2.loc[user, "none"] if user in PAPER_TABLE_2.index else None
        row = {"User": user} | {symbol: rules[symbol] for symbol in SYMBOLS}
        rows.append(row | {"Valid": results.value("p_valid", "truth", user=user, added="none"), "Valid, paper": paper})
    formats = dict.fromkeys(SYMBOLS, "cm") | dict.fromkeys(("Valid", "Valid, paper"), "pct")
    return Table(with_gaps(rows), formats)


def overlap(results: Results) -> Table:
    """Return which test paths with unseen items are valid to two users: by the truth, each shown model, and blindly."""
    first, second = pair(results)
    frame = overlaps(results.tables["judged"], (first, second), "new_items")
    titles = {
        "source": "According to", "both": "Both", "first": f"{first} only", "second": f"{second} only",
        "neither": "Neither", "overlap_found": "Overlap found", "q1": "Overlap found, q1", "q3": "Overlap found, q3",
    }  # fmt: skip
    named = with_gaps(pick(frame, titles, source=lambda name: "Truth" if name == "truth" else label(name)))
    return Table(named, dict.fromkeys(named.columns[1:], "pct"))


def reactions(results: Results) -> Table:
    """Return what each user reacts to: the effect of each added item by the truth, by models, and without an image."""
    asked = results.tables["interventions"]
    asked, rows = asked[asked["kind"] == "add"].set_index(["variant", "user", "symbol"]), []
    for user in results.users:
        truth = {s: asked.loc[(results.variants[0], user, s), "truth"] for s in results.added_symbols}
        rows.append({"User": user, "According to": "Truth"} | truth)
        for variant in (v for v in REACTS if v in results.variants):
            row = {"User": user, "According to": label(variant)}
            for symbol in results.added_symbols:
                mine = asked.loc[(variant, user, symbol)]
                row |= {symbol: mine["effect"]} | {f"{symbol}, {end}": mine[end] for end in ENDS}
            rows.append(row)
        rows.append({"User": user, "According to": label("blind")} | dict.fromkeys(results.added_symbols, 0.0))
    numbers = [f"{symbol}{end}" for symbol in results.added_symbols for end in ("", ", q1", ", q3")]
    frame = with_gaps(pd.DataFrame(rows, columns=["User", "According to", *numbers]))
    return Table(frame, dict.fromkeys(numbers, "effect"))


def change_of_user(results: Results) -> Table:
    """Return the effect of do(S := other) for each user and other: the truth, the shown models', and by counting.

    Counting: the difference between the two users' shares of valid random paths, which needs no image.
    """
    asked = results.tables["interventions"]
    asked = asked[asked["kind"] == "user"]
    share, rows = results.tables["p_valid"].query("added == 'none'").set_index("user")["truth"], []
    for (user, question), part in asked.groupby(["user", "question"], sort=False):
        part = part.set_index("variant")
        other = next((u for u in share.index if str(question).endswith(f"_{u}")), str(question))
        row = {"From": user, "To": other, "Truth": part["truth"].iloc[0]}
        for variant in (v for v in REACTS if v in part.index):
            row |= {label(variant): part.loc[variant, "effect"]}
            row |= {f"{label(variant)}, {end}": part.loc[variant, end] for end in ENDS}
        rows.append(row | {"Counting valid paths": share.get(other, np.nan) - share[user]})
    frame = with_gaps(rows)
    return Table(frame, dict.fromkeys(frame.columns[2:], "effect"))
