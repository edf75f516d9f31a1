"""The README's headline table is the report's table of claims: python -m pipeline.report.readme [--check]"""

import sys
from pathlib import Path

START, END = "<!-- headline: reports/tables/claims.md -->\n", "<!-- /headline -->"


def with_headline(readme: str, table: str) -> str:
    """`readme` with `table` between its two marks; ValueError if it lacks them."""
    if readme.count(START) != 1 or readme.count(END) != 1:
        raise ValueError(f"README.md needs the marks {START.strip()!r} and {END!r}, each once")
    before, rest = readme.split(START)
    return f"{before}{START}\n{table.strip()}\n\n{END}{rest.split(END)[1]}"


def _main(check: bool) -> int:
    readme, table = Path("README.md"), Path("reports/tables/claims.md")
    if not table.is_file():
        print(f"error: {table} is missing: run `make repro` first", file=sys.stderr)
        return 2
    text = with_headline(readme.read_text(), table.read_text())
    if not check:
        readme.write_text(text)
        return 0
    if text != readme.read_text():
        print(f"error: README.md does not show {table}: run `make readme`", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(_main("--check" in sys.argv[1:]))
