"""Render the templates of pages/: numbers by name and format, figures and tables numbered in order of appearance."""

import importlib
import math
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib
import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from pipeline.report import style
from pipeline.report.claims import claims_table, verdicts
from pipeline.report.pages.index.widget import widget
from pipeline.report.results import PAPER_ACCURACY, PAPER_TABLE_1, PAPER_TABLE_2, SOURCES, Results, checked

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
FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class Table:
    """A table of a page: its numbers as written to csv, and the format of each numeric column."""

    frame: pd.DataFrame
    formats: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Site:
    """All output: pages by name, figures as SVG text by file name, tables by file name."""

    pages: dict[str, str]
    figures: dict[str, str]
    tables: dict[str, pd.DataFrame]
    claims: dict[str, str]  # claim -> holds | fails | open | untestable


def render(results: Results, pages: Collection[str] = tuple(PAGES)) -> Site:
    """Return these pages with the figures and tables that their templates use.

    Raise InputError if a template uses a number that is missing or not finite.
    """
    results.check()
    claims = claims_table(results)
    tables = {"claims": claims} | {name: results.tables[name] for name in SOURCES}
    site = Site({}, {}, tables, verdicts(claims))
    environment = _environment(results, claims)
    for name in pages:
        template = environment.get_template(f"pages/{name}/page.html.j2")
        site.pages[name] = template.render(page=name, **_numbered(name, results, site, environment))
    return site


def _environment(results: Results, claims: pd.DataFrame) -> Environment:
    environment = Environment(
        loader=FileSystemLoader(FOLDER),
        undefined=StrictUndefined,
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals |= FORMATS | {
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
        "paper_valid": PAPER_TABLE_2,
        "label": style.label,
        "pages": PAGES,
        "widget": lambda: widget(results),
        "headings": headings,
        "brief": False,
        "formats": FORMATS,
    }
    return environment


def headings(content: str) -> list[tuple[str, str]]:
    """Return the id and the text of each section's heading, for the table of contents."""
    return re.findall(r'<h2 id="([^"]+)">([^<]+)</h2>', content)


def _claim(claims: pd.DataFrame, name: str, measure: str, column: str) -> Any:
    row = claims[(claims["claim"] == name) & (claims["measure"] == measure)]
    return checked(row[column].iloc[0] if len(row) == 1 else None, f"claim {name}, {measure}, {column}")


def _numbered(page: str, results: Results, site: Site, environment: Environment) -> dict[str, Callable]:
    """Return a page's `figure` and `table` functions, which draw, number and store their results in the site."""
    counts = {"figure": 0, "table": 0}

    def figure(name: str, alt: str, wide: bool = False, caller: Callable[[], str] = str) -> Markup:
        draw = getattr(importlib.import_module(f"pipeline.report.pages.{page}.figures"), name)
        counts["figure"] += 1
        with matplotlib.rc_context(style.RC):
            drawn = draw(results)
        file = f"{page}-{name.replace('_', '-')}"
        site.figures[file] = style.svg(drawn)
        width, height = (round(96 * inches) for inches in drawn.get_size_inches())
        part, chart = environment.get_template("figure.html.j2"), "<script>" in site.figures[file]
        size = {"width": width, "height": height, "wide": wide, "chart": chart}
        return Markup(part.render(file=file, alt=alt, number=counts["figure"], caption=caller(), **size))

    def table(name: str, caller: Callable[[], str] = str) -> Markup:
        made: Table = getattr(importlib.import_module(f"pipeline.report.pages.{page}.tables"), name)(results)
        counts["table"] += 1
        file = f"{page}-{name.replace('_', '-')}"
        site.tables[file] = made.frame
        part = environment.get_template("table.html.j2")
        rows = made.frame.to_dict("records")
        return Markup(part.render(file=file, table=made, rows=rows, number=counts["table"], caption=caller()))

    def table_number() -> str:
        """Return the number of a table whose markup is in the template."""
        counts["table"] += 1
        return f"Table {counts['table']}."

    return {"figure": figure, "table": table, "table_number": table_number}


# Formats: each raises for a number that is not finite; None marks a value that cannot exist, such as a baseline's
# seeds.


def _number(pattern: str, scale: float = 1.0) -> Callable[[Any], str]:
    def write(number: Any) -> str:
        if number is None:
            return "–"
        if not math.isfinite(number):
            raise ValueError(f"{number} in a page: expected a finite number; run the stage that writes it again")
        text = pattern.format(scale * number).replace("-", "−")
        return text.lstrip("+−") if float(pattern.format(scale * number).split("\u00a0")[0]) == 0 else text

    return write


def _spread(low: float, high: float) -> str:
    """Return a range of rates in per cent."""
    return f"{_number('{:.0f}', 100.0)(low)}–{_number('{:.0f}', 100.0)(high)}"


FORMATS: dict[str, Callable] = {
    "pct": _number("{:.0f}\u00a0%", 100.0),  # prose: whole per cents
    "pct1": _number("{:.1f}\u00a0%", 100.0),  # tables
    "points": _number("{:+.0f}", 100.0),
    "points1": _number("{:+.1f}", 100.0),
    "effect": _number("{:+.2f}"),
    "rate": _number("{:.2f}"),
    "fine": _number("{:.3f}"),
    "times": _number("{:.1f}"),
    "cm": _number("{:.1f}\u00a0cm", 100.0),
    "count": _number("{:.0f}"),
    "spread": _spread,
}
