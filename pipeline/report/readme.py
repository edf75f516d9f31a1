"""The README shows two of the report's tables: python -m pipeline.report.readme [--check]"""

import sys
from collections.abc import Mapping
from pathlib import Path

from pipeline.errors import InputError
from pipeline.writing import write_whole

TABLES = ("reports/tables/claims.md", "reports/tables/models.md")
END = "<!-- /table -->"


def with_tables(readme: str, tables: Mapping[str, str]) -> str:
    """`readme` with each table between the marks that name it; InputError if it lacks them."""
    for name, table in tables.items():
        start = f"<!-- table: {name} -->\n"
        before, found, rest = readme.partition(start)
        _, ended, after = rest.partition(END)
        if not (found and ended) or start in after:
            raise InputError(f"README.md needs the marks {start.strip()!r}, once, and {END!r} after it")
        readme = f"{before}{start}\n{table.strip()}\n\n{END}{after}"
    return readme


def _main(check: bool) -> int:
    readme = Path("README.md")
    lacking = [name for name in TABLES if not Path(name).is_file()]
    if lacking:
        print(f"error: {', '.join(lacking)} missing: run `make repro` first", file=sys.stderr)
        return 2
    text = with_tables(readme.read_text(), {name: Path(name).read_text() for name in TABLES})
    if not check:
        write_whole(readme, lambda part: part.write_text(text))
        return 0
    if text != readme.read_text():
        print(f"error: README.md does not show {' and '.join(TABLES)}: run `make readme`", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(_main("--check" in sys.argv[1:]))
