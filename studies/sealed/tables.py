"""Expectations beside what came."""

import pandas as pd

from pipeline.report.page import Table, pick
from pipeline.report.study import Study

TITLES = {"headline": "Headline", "expected": "Expected"}


def numbers(study: Study) -> Table:
    """Return a row a headline: the number expected, its interval, what came, whether it lies within."""
    table = study.table("numbers.csv", finite=("expected", "low", "high", "found"))
    return _table(table, TITLES | {"low": "From", "high": "To", "found": "Came"}, "digits")


def claims(study: Study) -> Table:
    """Return a row a claim of the paper: the verdict expected and the one that came."""
    return _table(study.table("claims.csv"), TITLES | {"found": "Came"}, None)


def surprises(study: Study) -> Table:
    """Return a row a headline that came otherwise: expected, what came, and what we know of the reason."""
    table = study.table("surprises.csv").astype(object).fillna("")
    return Table(pick(table, TITLES | {"found": "Came", "explanation": "Explanation, written afterwards"}))


def _table(table: pd.DataFrame, titles: dict[str, str], form: str | None) -> Table:
    frame = pick(table, titles | {"as_expected": "As expected", "why": "Why we expected it"})
    frame["As expected"] = ["yes" if right else "no" for right in table["as_expected"].astype(bool)]
    formats = {title: form for title in ("Expected", "From", "To", "Came") if form and title in frame}
    return Table(frame, formats)
