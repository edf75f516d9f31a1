"""Render the paper's pages from the templates of pages/."""

from collections.abc import Collection
from typing import Any

from pipeline.report import claims, derived, figures
from pipeline.report.page import Site, environment, render_page
from pipeline.report.results import PAPER_ACCURACY, PAPER_TABLE_1, SOURCES, Results
from pipeline.report.tables import lookup

PAGES = {"index": "Overview", "reproduction": "In one page", "claims": "Claims", "accuracy": "Accuracy"}
PAGES |= {"repair": "Repair", "causes": "Causes", "limits": "Limits", "users": "Users", "card": "Model card"}
PAGES |= {"method": "Method", "history": "History"}


def render(results: Results, pages: Collection[str] = tuple(PAGES)) -> Site:
    """Return these pages with the figures and tables that their templates use.

    Raise InputError if a template uses a number that is missing or not finite.
    """
    judged = claims.claims_table(results)
    tables = {"claims": judged} | {name: results.tables[name] for name in SOURCES}
    site = Site(tables=tables, claims=claims.verdicts(judged))
    names: dict[str, Any] = {"home": "", "pages": PAGES, "brief": False, "r": results, "n": results.main_n_demos}
    names |= {name: getattr(results, name) for name in ("value", "accuracy", "repair", "sliced", "variants", "facts")}
    names |= {"users": list(results.users), "judged": results.judged_users, "verdict": site.claims.__getitem__}
    names |= {"paper_accuracy": PAPER_ACCURACY, "paper_repair": PAPER_TABLE_1, "derived": derived}
    made = environment([], **names)
    made.globals["claim"] = lambda of, name, column: lookup(judged, "claims", column, claim=of, measure=name)
    made.globals["measures"] = lambda of: judged.loc[judged["claim"] == of, "measure"].tolist()
    macros: Any = made.get_template("study_link.html.j2").make_module(names)
    made.globals["study"] = macros.study
    for name in pages:
        render_page(name, f"pages/{name}.html.j2", figures, results, made, site, prefix=f"{name}-")
    return site
