"""The README's tables are the committed report's, word for word."""

from pathlib import Path

import pytest

from pipeline.report.readme import TABLES, with_tables

ROOT = Path(__file__).parent.parent.parent
MARKED = "a\n<!-- table: t.md -->\n\nold\n\n<!-- /table -->\nz\n"


def test_the_readme_shows_the_committed_tables():
    readme = (ROOT / "README.md").read_text()
    assert with_tables(readme, {name: (ROOT / name).read_text() for name in TABLES}) == readme


def test_a_table_replaces_what_stood_there_before():
    readme = MARKED + "<!-- table: u.md -->\n<!-- /table -->\n"
    new = with_tables(readme, {"t.md": "| new |\n", "u.md": "| other |\n"})
    assert "old" not in new and "| new |" in new and "| other |" in new and new.startswith("a\n")
    assert with_tables(new, {"t.md": "| new |\n"}) == new


@pytest.mark.parametrize("readme", ["no marks", MARKED * 2, MARKED.replace("/table", "/other")])
def test_a_readme_without_marks_is_refused(readme):
    with pytest.raises(ValueError, match="needs the marks"):
        with_tables(readme, {"t.md": "| table |"})
