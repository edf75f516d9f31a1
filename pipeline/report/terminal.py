"""The paper's two tables as the report has them, and where it is: python -m pipeline.report.terminal [FOLDER]"""

import sys
from pathlib import Path

TABLES = ("backprop", "interventions")


def shown(reports: Path) -> str:
    """Both tables and the report's path; FileNotFoundError if the report stage has not run."""
    missing = [p for p in (reports / "tables" / f"{name}.md" for name in TABLES) if not p.is_file()]
    if missing:
        raise FileNotFoundError(f"{missing[0]} is missing: run `make repro` (or `dvc repro report`) first")
    tables = [(reports / "tables" / f"{name}.md").read_text(encoding="utf-8") for name in TABLES]
    return "\n".join([*tables, f"The report: {reports / 'index.html'}"])


if __name__ == "__main__":
    try:
        print(shown(Path(sys.argv[1] if len(sys.argv) > 1 else "reports")))
    except FileNotFoundError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
