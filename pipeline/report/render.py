"""Render the paper's pages from the templates of pages/."""

from collections.abc import Collection
from typing import Any

import pandas as pd

from pipeline.report.bold import COLUMNS, NAMES
from pipeline.report.claims import claims_table, verdicts
from pipeline.report.page import FORMATS, Site, Table, checked, environment, render_page
from pipeline.report.pages import accuracy, card, causes, history, index, limits, method, repair, users
from pipeline.report.pages import claims as claims_page
from pipeline.report.results import PAPER_ACCURACY, PAPER_TABLE_1, SOURCES, Results
from pipeline.report.style import label

__all__ = ["FORMATS", "PAGES", "Site", "Table", "render"]
PAGES = {
    "index": "Overview",
    "claims": "Claims",
    "accuracy": "Accuracy",
    "repair": "Repair",
    "causes": "Causes",
    "limits": "Limits",
    "users": "Users",
    "card": "Model card",
    "method": "Method",
    "history": "History",
}
FIGURES = {  # what the template of each page draws with
    "index": index,
    "claims": claims_page,
    "accuracy": accuracy,
    "repair": repair,
    "causes": causes,
    "limits": limits,
    "users": users,
    "card": card,
    "method": method,
    "history": history,
}


def render(results: Results, pages: Collection[str] = tuple(PAGES)) -> Site:
    """Return these pages with the figures and tables that their templates use.

    Raise InputError if a template uses a number that is missing or not finite.
    """
    results.check()
    claims = claims_table(results)
    tables = {"claims": claims} | {name: results.tables[name] for name in SOURCES}
    site = Site(tables=tables, claims=verdicts(claims))
    made = environment([], **_names(results, claims))
    for name in pages:
        render_page(name, f"pages/{name}.html.j2", "", results, made, site, f"{name}-", FIGURES[name])
    return site


def _names(results: Results, claims: pd.DataFrame) -> dict[str, Any]:
    """Return what the paper's templates may name."""
    return {
        "home": "",
        "r": results,
        "value": results.value,
        "accuracy": results.accuracy,
        "repair": results.repair,
        "sliced": results.sliced,
        "variants": results.variants,
        "users": list(results.users),
        "judged": results.judged_users,
        "n": results.main_n_demos,
        "facts": results.facts,
        "claim": lambda name, measure, column: _claim(claims, name, measure, column),
        "verdict": lambda name: verdicts(claims)[name],
        "measures": lambda name: claims.loc[claims["claim"] == name, "measure"].tolist(),
        "paper_accuracy": PAPER_ACCURACY,
        "paper_repair": PAPER_TABLE_1,
        "pages": PAGES,
        "source": lambda name: NAMES.get(name) or label(name),
        "change": lambda name: COLUMNS.get(name, name.capitalize()),
        "brief": False,
    }


def _claim(claims: pd.DataFrame, name: str, measure: str, column: str) -> Any:
    row = claims[(claims["claim"] == name) & (claims["measure"] == measure)]
    return checked(row[column].iloc[0] if len(row) == 1 else None, f"claim {name}, {measure}, {column}")
