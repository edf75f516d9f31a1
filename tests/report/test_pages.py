"""Pages from the factory's tables, and those of studies: complete, consistent, within their limits."""

import hashlib
import re
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.files import read_json, write_table
from pipeline.report.page import Site, write_files, write_provenance
from pipeline.report.render import PAGES, render
from pipeline.report.results import SOURCES
from pipeline.report.study import Study
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import ROOT
from pipeline.stages import page as study_page
from tests.report import factory

WORDS = dict.fromkeys(PAGES, 800) | {"index": 450}  # of prose; tables apart
FEW = ("full", "classifier", "clearance")
LARGEST_SITE = 2 * 2**20  # bytes


def words(page: str) -> list[str]:
    """A page's visible words; a traced number may be part of one: "80 %."."""
    text = re.sub(r"<(title|style|script)\b.*?</\1>", " ", page, flags=re.DOTALL)
    return unescape(re.sub(r"<[^>]*>", " ", re.sub(r"</?data\b[^>]*>", "", text))).split()


def links(page: str) -> list[str]:
    return [unescape(link) for link in re.findall(r'<[^>]*?\s(?:href|src)="([^"]+)"', page)]


def ids(page: str) -> list[str]:
    return re.findall(r'<[^>]*?\sid="([^"]+)"', page)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("variants", "users"),
    [(("full",), ("careful",)), (("clearance", "irl_ranked"), ("normal", "aggressive")), (("ae", "clearance"), None)],
)
def test_every_page_renders_with_fewer_variants_and_users(variants: tuple[str, ...], users: tuple[str, ...] | None):
    users = users or ("careful", "normal")
    pages = render(factory.results(variants, users)).pages
    assert list(pages) == list(PAGES)
    name = {"full": "its model is right on", "clearance": "Our clearance model"}
    assert all(name[absent] not in pages["index"] for absent in {"full", "clearance"} - set(variants))
    assert all(user not in pages["repair"] for user in {"careful", "normal"} - set(users))


@pytest.mark.slow
def test_models_that_are_not_compared_and_a_user_who_is_not_judged_leave_no_false_word():
    made = replace(factory.results(shown=("irl_ranked",)), judged_users=["careful"])
    pages = render(made).pages
    assert "to move an arm" not in pages["index"]
    for name, words in (("accuracy", " accepts"), ("causes", " avoids"), ("repair", "’s model accepts")):
        assert f"The aggressive user{words}" in pages[name] and "The normal user" not in pages[name]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("page", "table", "wrong", "fault"),
    [
        ("accuracy", "scores", "ece", "finite"),
        ("causes", "interventions", "ci_low", "finite"),
        ("index", "curve", "mean", "finite"),
        ("index", "accuracy", "variant == 'full' and split == 'new_items'", "table accuracy has 0 rows"),
        ("repair", "repair", "method == 'constant_detour'", "table repair has 0 rows"),
        ("limits", "slices", "variant == 'clearance' and slice == 'all'", "table slices has 0 rows"),
    ],
)
def test_a_number_that_is_not_finite_and_a_missing_row_are_refused_and_named(page, table, wrong, fault):
    frame = factory.tables(FEW)[table]
    frame = frame.assign(**{wrong: np.nan}) if wrong in frame else frame.drop(frame.query(wrong).index)
    with pytest.raises(InputError, match=fault):
        render(factory.results(FEW, **{table: frame}), [page])


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_a_page_is_short_numbers_its_figures_and_tables_and_links_within_the_site(site: Site, page: str):
    html = site.pages[page]
    assert len(words(re.sub(r"<table\b.*?</table>", "", html, flags=re.DOTALL))) <= WORDS[page]
    for kind in ("Figure", "Table"):
        numbers = [int(n) for n in re.findall(rf"<b>{kind} (\d+)\.</b>", html)]
        assert numbers == list(range(1, len(numbers) + 1))
    figures = re.findall(r'<(?:img(?! class="printed")|object)[^>]*(?:alt|aria-label)="([^"]*)"', html)
    assert all(figures) and len(figures) == html.count("<figure")
    anchors = {name: ids(text) for name, text in site.pages.items()}
    files = {f"figures/{name}.svg" for name in site.figures} | {f"tables/{name}.csv" for name in site.tables}
    files |= {f"../studies/{name}/index.html" for name in factory.FACTS["studies"]} | {"page.css", "metrics.json"}
    for link in links(html):
        target, _, anchor = link.partition("#")
        name = (target or f"{page}.html").removesuffix(".html")
        assert target in files or name in site.pages, link
        assert not anchor or anchor in anchors[name], link
    assert len(set(anchors[page])) == len(anchors[page])


@pytest.mark.slow
def test_the_site_is_small_and_every_table_says_what_it_is_from(site: Site):
    assert sum(len(text.encode()) for text in [*site.pages.values(), *site.figures.values()]) < LARGEST_SITE
    for name, page in site.pages.items():
        tables = re.findall(r'aria-label="Table \d+"( title="From [^"]+; seeds 0, 1")?>', page)
        assert all(tables) and len(tables) == len(site.read.get(name, ())), name
    cell = "scores, auroc: split new_items, variant clearance; seeds 0, 1"
    assert f'title="{cell}">0.970 [0.100–0.100]' in site.pages["accuracy"]


@pytest.mark.slow
def test_a_cell_of_table_2_says_on_hover_what_it_rests_on(site: Site):
    said = re.findall(r'title="bold, mean: source (.*?), user careful, change (bowl|none); (.*?)"', site.pages["index"])
    notes = {(source, change): note for source, change, note in said}
    assert notes["the paper", "bowl"] == "as printed"
    assert notes["truth", "none"] == "scenes and items are chance"
    assert re.fullmatch(r"change -0\.150, 95 % .*p 0\.01 after Holm; training sets.*", notes["clearance", "bowl"])


@pytest.mark.slow
def test_every_page_renders_from_the_committed_tables():
    site = render(factory.results(**{name: pd.read_csv(ROOT / f"reports/tables/{name}.csv") for name in SOURCES}))
    for page in site.pages.values():
        assert not re.search(r"\b(nan|inf|None|NaN)\b", " ".join(words(page)))
    for headline in pd.read_csv(ROOT / "docs/expectations.csv").headline:  # all of them, not only what surprised
        assert f">{headline}</th>" in site.pages["history"], headline


@pytest.mark.parametrize("folder", [path.parent for path in ROOT.glob("studies/*/index.html")], ids=lambda f: f.name)
def test_a_study_has_a_short_page_whose_links_lead_somewhere(folder: Path):
    page = (folder / "index.html").read_text()
    assert len(words(page)) <= 1200
    for link in links(page):
        target, _, anchor = link.partition("#")
        assert not target or (folder / target).resolve().is_file(), link
        assert target or anchor in ids(page), link
    for kind, ending in (("figures", "svg"), ("tables", "csv")):
        linked = {Path(link).name for link in links(page) if link.startswith(f"{kind}/")}
        assert {path.name for path in folder.glob(f"{kind}/*.{ending}")} == linked


TABLES = [*ROOT.glob("reports/tables/*.csv"), *ROOT.glob("studies/*/tables/*.csv")]


@pytest.mark.parametrize("path", TABLES, ids=lambda path: f"{path.parts[-3]}-{path.stem}")
def test_an_interval_stands_behind_the_number_that_it_is_about(path: Path):
    table = pd.read_csv(path)
    for low in [column for column in table if column.endswith(", low")]:
        name = low.removesuffix(", low")
        rows = table[[low, name, f"{name}, high"]].dropna().to_numpy(float)
        assert (np.diff(rows) >= -1e-9).all(), name


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """A study whose page prints one number, and its table."""
    write_table(tmp_path / "summary.csv", pd.DataFrame({"variant": ["full", ""], "accuracy": [0.5, 0.6]}))
    template = '{% extends "study.html.j2" %}{% block study %}{{ pct(value("summary.csv", "accuracy", variant="")) }}'
    (tmp_path / "page.html.j2").write_text(template + "{% endblock %}")
    facts = {"data_md5": "0123456789", "profile": "smoke", "root_seed": 1, "settings": "seeds: 2", "studies": ["q"]}
    settings = {"question": "Does it hold?"}
    shared: dict[str, Any] = {"variants": ["full"], "users": {"careful": {}}, "judged_users": ["careful"], "seeds": [0]}
    return Study(name="q", folder=tmp_path, settings=settings, main_n_demos=9, facts=facts, **shared)


def test_a_study_s_page_prints_its_question_its_numbers_and_how_it_was_made(study: Study):
    page = study_page.render(study, study.folder).pages["index"]
    for text in ("<h1>Does it hold?</h1>", "60\u00a0%", "smoke run", "01234567", "seeds: 2", "../../reports/page.css"):
        assert text in page


@pytest.mark.parametrize(("rows", "fault"), [([0.5, np.nan], "finite"), ([0.5, np.inf], "finite"), ([0.5], "0 rows")])
def test_a_number_of_a_study_that_is_missing_or_not_finite_is_refused(study: Study, rows: list[float], fault: str):
    table = pd.DataFrame({"variant": ["full", ""][: len(rows)], "accuracy": rows})
    write_table(study.folder / "summary.csv", table)
    with pytest.raises(InputError, match=fault):
        study_page.render(study, study.folder)
    with pytest.raises(InputError, match="no row"):
        study.values("summary.csv", "accuracy", variant="ae")


def test_provenance_names_the_file_behind_each_table_and_old_figures_and_tables_go(study: Study, tmp_path: Path):
    site = Site(sources={"summary.csv": [("q", study.folder / "summary.csv")]}, read={"index": {"t": []}})
    write_provenance(site, study.folder, {"seeds": [0]})
    md5 = hashlib.md5((study.folder / "summary.csv").read_bytes()).hexdigest()
    sources = {"summary.csv": [{"stage": "q", "file": "summary.csv", "md5": md5}]}
    assert read_json(study.folder / "provenance.json") == {"sources": sources, "pages": site.read, "seeds": [0]}
    for name in ("old", "new"):
        write_files(Site(figures={name: ""}, tables={name: pd.DataFrame({"a": [1]})}), tmp_path / "out")
    assert sorted(path.name for path in (tmp_path / "out").rglob("*.*")) == ["new.csv", "new.svg"]
