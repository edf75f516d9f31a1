"""Verdicts on every question, and each model's number of right verdicts."""

import pandas as pd

from pipeline.report.bold import bold_table
from pipeline.report.page import Table, pick
from pipeline.report.results import Results
from pipeline.report.style import label
from pipeline.stats.tests import verdict

SMALLEST = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08)  # smallest effects of interest to compare


def bold(results: Results) -> Table:
    """Return the paper's Table 2 by every source."""
    return bold_table(results.tables["bold"])


def score(results: Results) -> Table:
    """Return each model's number of right verdicts on added items and on changes of user."""
    rows = []
    for variant in results.variants:
        row = {"Model": label(variant), "Added items": results.verdicts_right(variant)}
        rows.append(row | {"Change of user": results.verdicts_right(variant, "user")})
    blind = {"Added items": results.image_blind_right(), "Change of user": results.image_blind_right("user")}
    rows.append({"Model": "A model that never sees the image"} | blind)
    asked = {"Added items": results.questions(), "Change of user": results.questions("user")}
    rows.append({"Model": "Questions"} | asked)
    return Table(pd.DataFrame(rows), {"Added items": "count", "Change of user": "count"})


def verdicts(results: Results) -> Table:
    """Return effect, 95 % interval and verdict of the paper's model and the clearance model, with the truth."""
    shown = [v for v in ("full", "clearance") if v in results.variants] or results.variants[:1]
    table = pd.concat([results.asked("add", v).sort_values(["user", "symbol"]) for v in shown])
    titles = {
        "variant": "Model", "user": "User", "symbol": "Added", "effect": "Effect", "ci_low": "low", "ci_high": "high",
        "truth": "Truth", "verdict": "Verdict", "right": "Right",
    }  # fmt: skip
    frame = pick(table, titles, variant=label, right=lambda right: "yes" if right else "no")
    return Table(frame, dict.fromkeys(("Effect", "low", "high", "Truth"), "effect"))


def sensitivity(results: Results) -> Table:
    """Return each model's number of right verdicts on added items for several smallest effects of interest.

    The truth stays as it is judged at the limit fixed in advance.
    """
    rows = []
    for variant in results.variants:
        asked = results.asked("add", variant)
        numbers = asked[["effect", "p_holm", "ci90_low", "ci90_high"]].itertuples(index=False)
        questions = list(zip(numbers, asked["truth_verdict"], strict=True))
        right = {f"{s:.2f}": sum(verdict(*x, smallest=s) == truth for x, truth in questions) for s in SMALLEST}
        rows.append({"Model": label(variant)} | right)
    return Table(pd.DataFrame(rows), {f"{s:.2f}": "count" for s in SMALLEST})
