"""Study pages: each lies whole in its study's folder, and none shows a number that is missing."""

import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.files import read_json, write_table
from pipeline.report.page import Site, write_files, write_provenance
from pipeline.report.study import Source, Study
from pipeline.runtime.errors import InputError
from pipeline.stages.page import render
from tests.report.test_pages import Reader

ROOT = Path(__file__).parents[2]
FOLDERS = sorted(path.parent for path in ROOT.glob("studies/*/page.html.j2"))


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_a_study_has_a_short_page_whose_links_lead_somewhere(folder: Path):
    text = (folder / "index.html").read_text()
    assert len(Reader(text).words) <= 1200
    page = Reader(text)
    for link in page.links:
        target, _, anchor = link.partition("#")
        assert not target or (folder / target).resolve().is_file(), link
        assert target or anchor in page.ids, link
    for kind, ending in (("figures", "svg"), ("tables", "csv")):
        linked = {Path(link).name for link in page.links if link.startswith(f"{kind}/")}
        assert {path.name for path in folder.glob(f"{kind}/*.{ending}")} == linked


@pytest.fixture
def study(tmp_path: Path) -> Study:
    """A study whose page prints one number, and its table."""
    write_table(tmp_path / "summary.csv", pd.DataFrame({"variant": ["full", ""], "accuracy": [0.5, 0.6]}))
    template = '{% extends "study.html.j2" %}{% block study %}{{ pct(value("summary.csv", "accuracy", variant="")) }}'
    (tmp_path / "page.html.j2").write_text(template + "{% endblock %}")
    facts = {"data_md5": "0123456789", "profile": "smoke", "root_seed": 1, "settings": "seeds: 2", "studies": ["q"]}
    settings = {"question": "Does it hold?"}
    shared = {"variants": ["full"], "users": {"careful": {}}, "judged_users": ["careful"], "seeds": [0]}
    return Study(name="q", folder=tmp_path, settings=settings, main_n_demos=9, facts=facts, **shared)


def test_a_study_s_page_prints_its_question_its_numbers_and_how_it_was_made(study: Study):
    page = render(study, study.folder).pages["index"]
    for text in ("<h1>Does it hold?</h1>", "60\u00a0%", "smoke run", "01234567", "seeds: 2", "../../reports/page.css"):
        assert text in page


def test_provenance_names_the_file_behind_each_table_and_its_md5(study: Study):
    site = Site(sources={"summary.csv": Source((("q", study.folder / "summary.csv"),))}, read={"index": {"t": []}})
    write_provenance(site, study.folder, {"seeds": [0]})
    written = read_json(study.folder / "provenance.json")
    md5 = hashlib.md5((study.folder / "summary.csv").read_bytes()).hexdigest()
    assert written["sources"] == {"summary.csv": [{"stage": "q", "file": "summary.csv", "md5": md5}]}
    assert written["pages"] == {"index": {"t": []}} and written["seeds"] == [0]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_refused(study: Study, bad: float):
    write_table(study.folder / "summary.csv", pd.DataFrame({"variant": ["full", ""], "accuracy": [0.5, bad]}))
    with pytest.raises(InputError, match="expected a finite number"):
        render(study, study.folder)


def test_a_number_that_is_missing_is_refused(study: Study):
    write_table(study.folder / "summary.csv", pd.DataFrame({"variant": ["full"], "accuracy": [0.5]}))
    with pytest.raises(InputError, match="has 0 rows"):
        render(study, study.folder)
    with pytest.raises(InputError, match="no row"):
        study.values("summary.csv", "accuracy", variant="ae")


def test_figures_and_tables_of_an_earlier_run_are_removed(tmp_path: Path):
    for name in ("old", "new"):
        write_files(Site(figures={name: ""}, tables={name: pd.DataFrame({"a": [1]})}), tmp_path)
    assert sorted(path.name for path in tmp_path.rglob("*.*")) == ["new.csv", "new.svg"]
