"""The page a reader opens: one HTML file with everything inside it."""

import re
from collections.abc import Mapping, Sequence

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from pipeline.errors import InputError
from pipeline.report.findings.ablation import ablation
from pipeline.report.findings.acceptance import acceptance
from pipeline.report.findings.accuracy import accuracy, calibration
from pipeline.report.findings.causes import interventions, selftest, specifications
from pipeline.report.findings.confounding import confounding
from pipeline.report.findings.counterfactuals import counterfactuals
from pipeline.report.findings.doubts import doubts
from pipeline.report.findings.efficiency import efficiency
from pipeline.report.findings.misspecification import misspecification
from pipeline.report.findings.refutation import refutation
from pipeline.report.findings.repair import repair, searches
from pipeline.report.findings.robustness import robustness
from pipeline.report.findings.summary import summary, world
from pipeline.report.findings.users import envelopes, identification
from pipeline.report.panel import script_json
from pipeline.report.pictures.picture import Picture
from pipeline.report.pictures.recordings import Shown
from pipeline.report.results import Results
from pipeline.report.style import LETTER, inline
from pipeline.report.table import Table, to_html
from pipeline.report.wording import counted, listed, variant_label

_SAY = (
    summary, world, accuracy, efficiency, calibration, ablation, acceptance, robustness, misspecification, repair,
    searches,
    interventions, specifications, refutation, confounding, counterfactuals, envelopes, identification, selftest,
    doubts,
)  # fmt: skip
LARGEST = 12_000_000  # bytes a page may have: room for two more users or variants


def render(
    results: Results,
    tables: Mapping[str, Table],
    pictures: Mapping[str, Picture],
    recordings: Sequence[Shown],
    facts: Mapping[str, object],
    panel: Mapping[str, object],
) -> str:
    """index.html; InputError if it would be larger than LARGEST.

    recordings: pictures of them; facts: what the text says of the setting (margins, the numbers of scenes and steps);
    panel: the panel's data.
    """
    environment = Environment(
        loader=PackageLoader("pipeline.report"), undefined=StrictUndefined, autoescape=True, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["typeset"] = _typeset
    environment.globals |= {
        "table": lambda name: Markup(_typeset(to_html(tables[name]).replace("&#x27;", "'"))),
        "svg": lambda text, name: Markup(inline(text, name)),
        "listed": listed,
        "counted": counted,
        "variant_label": variant_label,
    }
    html = environment.get_template("page.html.j2").render(
        r=results,
        facts=facts,
        pictures=pictures,
        recordings=recordings,
        findings={f.__name__: f for f in _SAY},
        panel=panel,
        panel_json=Markup(script_json(panel)),
    )  # fmt: skip
    html = _with_letters_once(html)
    if len(html.encode()) > LARGEST:
        raise InputError(
            f"the report has {len(html.encode()):,} bytes: expected at most {LARGEST:,}; lower "
            "report.panel_scenes, report.scenes or report.reconstructed, or name fewer variants in report.shown"
        )
    return html


def _with_letters_once(html: str) -> str:
    """Figures draw letters from outlines of their own: those of all of them, each once, at the head of the page."""
    outline = re.compile(rf'\s*<path id="({LETTER}[^"]*)"[^>]*/>')
    outlines = {found[1]: found[0] for found in outline.finditer(html)}
    letters = f'<svg class="letters" aria-hidden="true"><defs>{"".join(outlines.values())}</defs></svg>'
    return outline.sub("", html).replace("<body>", f"<body>\n{letters}", 1)


def _typeset(text: str) -> str:
    """Curly apostrophes; a number stays on the line of its sign, its unit and its name."""
    return re.sub(r"(?<=[=±]) (?=\d)|(?<=\d) (?=%)|(?<=\b\w) (?==)", "\u00a0", text.replace("'", "’"))
