"""Pages from the factory's tables: complete, consistent, within their limits."""

import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.report.page import Site
from pipeline.report.render import PAGES, render
from pipeline.report.results import SOURCES
from pipeline.runtime.errors import InputError
from tests.report import factory

pytestmark = pytest.mark.slow

TABLES = Path(__file__).parents[2] / "reports/tables"
WORDS = dict.fromkeys(PAGES, 800) | {"index": 480}  # of prose; tables apart
FEW = ("full", "classifier", "clearance")
LARGEST_SITE = 2 * 2**20  # bytes


class Reader(HTMLParser):
    """Collects a page's visible words, and what it links to."""

    def __init__(self, page: str):
        super().__init__()
        self.words: list[str] = []
        self.links: list[str] = []
        self.ids: list[str] = []
        self._hidden = self._within_word = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        self._within_word &= tag == "data"  # a traced number may be part of a word: "80 %."
        self._hidden = tag in ("title", "style", "script")
        self.links += [link for name in ("href", "src") if (link := values.get(name))]
        self.ids += [name for name in [values.get("id")] if name]

    def handle_endtag(self, tag: str) -> None:
        self._hidden = False
        self._within_word &= tag == "data"

    def handle_data(self, data: str) -> None:
        if not self._hidden:
            words = data.split()
            if self._within_word and words and not data[0].isspace():
                self.words[-1] += words.pop(0)
            self.words += words
            self._within_word = not data[-1].isspace()


@pytest.mark.parametrize(
    ("variants", "users"),
    [
        (("full",), ("careful",)),
        (("clearance", "irl_ranked"), ("normal", "aggressive")),
        (("ae", "clearance"), ("careful", "normal")),  # not every fit of ae passes the gate
    ],
)
def test_every_page_renders_with_fewer_variants_and_users(variants: tuple[str, ...], users: tuple[str, ...]):
    pages = render(factory.results(variants, users)).pages
    assert list(pages) == list(PAGES)
    name = {"full": '<h2 class="plain">The paper’s model', "clearance": '<h2 class="plain">The clearance model'}
    assert all(name[absent] not in pages["index"] for absent in {"full", "clearance"} - set(variants))
    assert all(user not in pages["repair"] for user in {"careful", "normal"} - set(users))


@pytest.mark.parametrize(
    ("page", "table", "column"),
    [("accuracy", "scores", "ece"), ("causes", "interventions", "ci_low"), ("index", "curve", "mean")],
)
def test_a_number_of_a_table_or_figure_is_refused_if_it_is_not_finite(page: str, table: str, column: str):
    frame = factory.tables(FEW)[table].assign(**{column: np.nan})
    with pytest.raises(InputError, match="finite"):
        render(factory.results(FEW, **{table: frame}), [page])


@pytest.mark.parametrize(
    ("page", "table", "rows"),
    [
        ("index", "accuracy", "variant == 'full' and split == 'new_items'"),
        ("repair", "repair", "method == 'constant_detour'"),
        ("limits", "slices", "variant == 'clearance' and slice == 'all'"),
    ],
)
def test_a_missing_row_is_refused_and_named(page: str, table: str, rows: str):
    frame = factory.tables(FEW)[table]
    with pytest.raises(InputError, match=f"table {table} has 0 rows"):
        render(factory.results(FEW, **{table: frame.drop(frame.query(rows).index)}), [page])


@pytest.mark.parametrize("page", PAGES)
def test_pages_stay_short(site: Site, page: str):
    prose = re.sub(r"<table\b.*?</table>", "", site.pages[page], flags=re.DOTALL)
    assert len(Reader(prose).words) <= WORDS[page]


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_somewhere_in_the_site_and_none_out_of_it(site: Site, page: str):
    ids = {name: Reader(text).ids for name, text in site.pages.items()}
    files = {f"figures/{name}.svg" for name in site.figures} | {f"tables/{name}.csv" for name in site.tables}
    files |= {f"../studies/{name}/index.html" for name in factory.results(FEW).facts["studies"]}
    for link in Reader(site.pages[page]).links:
        target, _, anchor = link.partition("#")
        name = (target or f"{page}.html").removesuffix(".html")
        assert target in files | {"page.css", "metrics.json"} or name in site.pages, link
        assert not anchor or anchor in ids[name], link
    assert len(set(ids[page])) == len(ids[page])


def test_every_table_says_what_it_is_from_and_a_cell_drawn_from_one_row_says_which(site: Site):
    for name, page in site.pages.items():
        tables = re.findall(r'aria-label="Table \d+"( title="From [^"]+; seeds 0, 1")?>', page)
        assert all(tables) and len(tables) == len(site.read.get(name, ())), name
    cell = "scores, auroc: split new_items, variant clearance; seeds 0, 1"
    assert f'title="{cell}">0.970 [0.100–0.100]' in site.pages["accuracy"]


def test_every_page_renders_from_the_committed_tables():
    tables = {name: pd.read_csv(TABLES / f"{name}.csv") for name in SOURCES}
    site = render(factory.results(**tables))
    for page in site.pages.values():
        assert not re.search(r"\b(nan|inf|None|NaN)\b", " ".join(Reader(page).words))


def test_the_site_is_small(site: Site):
    assert sum(len(text.encode()) for text in [*site.pages.values(), *site.figures.values()]) < LARGEST_SITE


def test_figures_and_tables_are_numbered_in_order(site: Site):
    for page in site.pages.values():
        for kind in ("Figure", "Table"):
            numbers = [int(n) for n in re.findall(rf"<b>{kind} (\d+)\.</b>", page)]
            assert numbers == list(range(1, len(numbers) + 1))
