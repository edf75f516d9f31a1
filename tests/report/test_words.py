"""The words of templates and README: spelling, length of sentences, no home-made terms."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
TEMPLATES = sorted([*(ROOT / "pipeline/report").rglob("*.j2"), *(ROOT / "studies").glob("*/*.j2")])
BANNED = [
    line for line in (Path(__file__).parent / "banned_words.txt").read_text().splitlines() if not line.startswith("#")
]
MOST_WORDS = 30  # in a sentence; a number or name that is filled in counts as one


def template_words(path: Path) -> str:
    """Return a template's visible text: expressions become one word, blocks end sentences."""
    text = re.sub(r"\{#.*?#\}", "", path.read_text(), flags=re.DOTALL)
    text = re.sub(r"alt=\"([^\"]*)\"", r"%}\1. {%", text)
    text = re.sub(r"\{\{.*?\}\}", "9", text, flags=re.DOTALL)
    text = re.sub(r"\{% (else|elif|endfor|endif|for|if|endcall|endblock).*?%\}", " ", text)
    text = re.sub(r"\{%.*?%\}", ". ", text, flags=re.DOTALL)
    text = re.sub(r"</?(p|li|h\d|td|th|tr|title|figcaption|caption|table|ul|section)\b[^>]*>", ". ", text)
    return re.sub(r"<[^>]*>", "", text)


def readme_words() -> str:
    """Return the prose of the README's results: without code, table rows and comments; a link is its text."""
    block = (ROOT / "README.md").read_text().partition("## Results")[2].partition("\n## ")[0]
    return re.sub(r"^\|.*$|`[^`]*`|!?\[([^\]]*)\]\([^)]*\)|<!--.*?-->", r"\1", block, flags=re.MULTILINE)


TEXTS = {str(path.relative_to(ROOT)): template_words(path) for path in TEMPLATES} | {"README.md": readme_words()}


@pytest.mark.parametrize("name", TEXTS)
def test_no_sentence_is_longer_than_thirty_words(name: str):
    sentences = re.split(r"[.!?:]\s", TEXTS[name])
    assert [s for s in sentences if len(s.split()) > MOST_WORDS] == []


@pytest.mark.parametrize("name", TEXTS)
def test_no_home_made_term_is_used(name: str):
    assert [word[0] for term in BANNED for word in re.finditer(term, TEXTS[name], re.IGNORECASE)] == []


def test_every_word_is_spelled_as_in_a_dictionary():
    done = subprocess.run(
        [sys.executable, "-m", "codespell_lib", *map(str, TEMPLATES)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("path", TEMPLATES, ids=lambda path: path.parent.name)
def test_no_rate_is_typed(path: Path):
    """A rate in per cent comes from a table; 95 % and 90 % are names of intervals, 70 % and 99 % of examples."""
    typed = re.findall(r"\b(\d+(?:\.\d+)?)\s?(?:%|per cent)(?!\})", re.sub(r"\{[{%].*?[}%]\}", "", path.read_text()))
    assert set(typed) <= {"95", "90", "70", "99"}
