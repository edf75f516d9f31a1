"""Every draw of test scenes, every change made because of a test, and how many settings each learner was given."""

import pandas as pd

from pipeline.report.page import Table, pick, with_gaps
from pipeline.report.results import Results
from pipeline.report.style import label

VARIANTS = ("clearance", "irl_ranked", "irl_maxent", "full")


def draws(results: Results) -> Table:
    """Return a row per draw: accuracies with unseen items, and what was changed after it was opened."""
    table = results.tables["draws"]
    frame = pd.DataFrame({"Root seed": table["root_seed"].map(str)})
    frame = frame.assign(**{label(v): table[v] for v in VARIANTS})
    frame["Changed afterwards"] = table["changed_after_opening"].fillna("nothing")
    return Table(with_gaps(frame), dict.fromkeys(map(label, VARIANTS), "pct1"))


def changes(results: Results) -> Table:
    """Return every change made because of a test, in the order of the draws."""
    table = results.tables["changes"].sort_values("after_draw", kind="stable")
    titles = {"after_draw": "After", "test": "Test", "what_it_showed": "It showed", "change": "So we changed"}
    return Table(pick(table, titles | {"record": "Record"}, after_draw=str, record="{:03d}".format))


def surprises(results: Results) -> Table:
    """Return what came otherwise than expected in the second edition's sealed run."""
    table = results.tables["sealed"]
    titles = {"headline": "Headline", "expected": "Expected", "low": "From", "high": "To", "found": "Came"}
    shown = pick(table[table["as_expected"] != "yes"], titles | {"explanation": "Explanation, written afterwards"})
    return Table(shown.astype(object).fillna(""))


def effort(results: Results) -> Table:
    """Return how many settings were tried for each learner in the first edition."""
    names = {"learner": "Learner", "settings": "Settings tried", "what_was_varied": "Varied"}
    return Table(pick(results.tables["effort"], names), {"Settings tried": "count"})
