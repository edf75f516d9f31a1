"""Write the page of a sweep."""

import shutil
from pathlib import Path
from typing import Any

from pipeline.artifacts.files import write_table
from pipeline.audit.difference import MIN_PAIRS, p_text
from pipeline.report.page import FOLDER, Site, environment, render_page, write_files
from pipeline.sweep.page import figures, tables
from pipeline.sweep.summary import summarise


def write_summary(folder: Path, record: dict[str, Any], jobs: list[dict[str, Any]]) -> Path:
    """Write index.html with its figures and tables, and the tidy tables as parquet; return the page's path."""
    summary = summarise(record, jobs)
    site = Site()
    names = {"home": "", "pages": {"index": "Sweep"}, "facts": {"studies": []}}
    names |= {"p_text": p_text, "few": MIN_PAIRS}
    names |= {"s": summary, "tables": tables, "best": tables.best, "title": tables.title}
    made = environment([Path(__file__).parent], **names)
    render_page("index", "page.html.j2", figures, summary, made, site)
    write_files(site, folder)
    shutil.copy(FOLDER / "page.css", folder)
    for name in ("results", "differences", "comparisons"):
        write_table(folder / f"{name}.parquet", getattr(summary, name))
    return folder / "index.html"
