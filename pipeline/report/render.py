"""Render the paper's pages from the templates of pages/."""

from collections.abc import Collection
from typing import Any

import pandas as pd

from pipeline.report import claims, derived, figures
from pipeline.report.page import Site, environment, render_page
from pipeline.report.results import PAPER_ACCURACY, PAPER_TABLE_1, SOURCES, Results
from pipeline.report.tables import lookup

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


def render(results: Results, pages: Collection[str] = tuple(PAGES)) -> Site:
    """Return these pages with the figures and tables that their templates use.

    Raise InputError if a template uses a number that is missing or not finite.
    """
    judged = claims.claims_table(results)
    tables = {"claims": judged} | {name: results.tables[name] for name in SOURCES}
    site = Site(tables=tables, claims=claims.verdicts(judged))
    made = environment([], **_names(results, judged))
    for name in pages:
        render_page(name, f"pages/{name}.html.j2", figures, results, made, site, prefix=f"{name}-")
    return site


def _names(results: Results, judged: pd.DataFrame) -> dict[str, Any]:
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
        "claim": lambda name, measure, column: lookup(judged, "claims", column, claim=name, measure=measure),
        "verdict": lambda name: claims.verdicts(judged)[name],
        "measures": lambda name: judged.loc[judged["claim"] == name, "measure"].tolist(),
        "paper_accuracy": PAPER_ACCURACY,
        "paper_repair": PAPER_TABLE_1,
        "pages": PAGES,
        "derived": derived,
        "rates": claims.rates,
        "brief": False,
    }
