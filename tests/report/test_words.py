"""The words of pages, templates and README: length of sentences, no home-made terms."""

import re
from html import unescape
from pathlib import Path

import pytest

from pipeline.report.page import Site
from pipeline.report.render import PAGES

ROOT = Path(__file__).parents[2]
TEMPLATES = sorted([*(ROOT / "pipeline/report").rglob("*.j2"), *(ROOT / "studies").glob("*/*.j2")])
BANNED = [
    line for line in (Path(__file__).parent / "banned_words.txt").read_text().splitlines() if not line.startswith("#")
]
MOST_WORDS = 30  # in a sentence; a number or name that is filled in counts as one
BLOCKS = r"</?(p|li|h\d|td|th|tr|title|figcaption|caption|table|ul|ol|section|nav|footer|option|label|button)\b[^>]*>"


def template_words(path: Path) -> str:
    """Return a template's visible text: expressions become one word, blocks end sentences."""
    text = re.sub(r"\{#.*?#\}", "", path.read_text(), flags=re.DOTALL)
    text = re.sub(r"alt=\"([^\"]*)\"", r"%}\1. {%", text)
    text = re.sub(r"\{\{.*?\}\}", "9", text, flags=re.DOTALL)
    text = re.sub(r"\{% (else|elif|endfor|endif|for|if|endcall|endblock).*?%\}", " ", text)
    text = re.sub(r"\{%.*?%\}", ". ", text, flags=re.DOTALL)
    return re.sub(r"<[^>]*>", "", re.sub(BLOCKS, ". ", text))


def page_words(page: str) -> str:
    """Return a page's visible text and its alt texts: blocks end sentences."""
    text = re.sub(r"<(style|script|svg)\b.*?</\1>", "", page, flags=re.DOTALL)
    text = re.sub(r"<img[^>]*\balt=\"([^\"]*)\"[^>]*>", r"\1. ", text)
    return unescape(re.sub(r"<[^>]*>", "", re.sub(BLOCKS, ". ", text)))


def readme_words() -> str:
    """Return the prose of the README: without code, table rows and what is filled in; a link is its text."""
    text = re.sub(r"<!-- (\w+) -->.*?<!-- /\1 -->|\*", "", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    return re.sub(r"^\|.*$|^ {4}.*$|`[^`]*`|!?\[([^\]]*)\]\([^)]*\)", r"\1", text, flags=re.MULTILINE)


def faults(text: str) -> list[str]:
    """Return the sentences that are too long, and the home-made terms."""
    too_long = [s for s in re.split(r"[.!?:]\s", text) if len(s.split()) > MOST_WORDS]
    return too_long + [word[0] for term in BANNED for word in re.finditer(term, text, re.IGNORECASE)]


TEXTS = {str(path.relative_to(ROOT)): template_words(path) for path in TEMPLATES} | {"README.md": readme_words()}


@pytest.mark.parametrize("name", TEXTS)
def test_no_sentence_is_longer_than_thirty_words_and_no_home_made_term_is_used(name: str):
    assert faults(TEXTS[name]) == []


def test_the_readme_is_read_in_three_minutes():
    text = re.sub(r"<!-- (\w+) -->.*?<!-- /\1 -->\n?", "", (ROOT / "README.md").read_text(), flags=re.DOTALL)
    assert len(readme_words().split()) <= 700 and len(text.splitlines()) <= 90


@pytest.mark.slow
def test_rendered_pages_read_as_well_as_their_templates(site: Site):
    found = {name: faults(page_words(page)) for name, page in site.pages.items()}
    assert found == {name: [] for name in PAGES}


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.parent.name)
def test_no_rate_is_typed(path: Path):
    """A rate in per cent comes from a table; the others are names of intervals, ranges and thresholds."""
    typed = re.findall(r"\b(\d+(?:\.\d+)?)\s?(?:%|per cent)(?!\})", re.sub(r"\{[{%].*?[}%]\}", "", path.read_text()))
    assert set(typed) <= {"95", "90", "80", "70", "99", "99.5"}
