"""The README's headline is the committed report's table of claims, word for word."""

from pathlib import Path

import pytest

from pipeline.report.readme import with_headline

ROOT = Path(__file__).parent.parent.parent


def test_the_readme_shows_the_committed_table_of_claims():
    readme = (ROOT / "README.md").read_text()
    assert with_headline(readme, (ROOT / "reports/tables/claims.md").read_text()) == readme


def test_the_table_replaces_what_stood_there_before():
    readme = "a\n<!-- headline: reports/tables/claims.md -->\n\nold\n\n<!-- /headline -->\nz\n"
    new = with_headline(readme, "| new |\n")
    assert "old" not in new and "| new |" in new and new.startswith("a\n") and new.endswith("z\n")
    assert with_headline(new, "| new |\n") == new


def test_a_readme_without_marks_is_refused():
    with pytest.raises(ValueError, match="needs the marks"):
        with_headline("no marks", "| table |")
