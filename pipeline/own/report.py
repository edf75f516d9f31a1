"""Write the report on a folder: page, figures, tables, metrics; all of it or nothing."""

import shutil
from pathlib import Path
from typing import Any

from pipeline.artifacts.files import write_json, write_table
from pipeline.own.fitting import FOLDS, VARIANT
from pipeline.own.recording import write_recording
from pipeline.own.results import Results
from pipeline.own.tables import without_formulas
from pipeline.report.page import FOLDER as SHARED
from pipeline.report.page import Site, environment, lookup, render_page, write_files

BLIND = ("nearest_demonstration", "position_only")


def render(results: Results) -> Site:
    """Return the page with its figures and tables; texts of the tables are safe to open in a spreadsheet."""
    site = Site()
    made = environment([Path(__file__).parent], **_names(results))
    render_page("index", "page.html.j2", "pipeline.own", results, made, site)
    site.tables.update(results.tables)
    for name, table in site.tables.items():
        site.tables[name] = without_formulas(table)
    return site


def _names(results: Results) -> dict[str, Any]:
    """Return what the template may name."""

    def score(user: str, predictor: str, column: str) -> float:
        return lookup(results.scores, "scores", column, user=user, predictor=predictor, share=1.0)

    def reacts(user: str) -> list[str] | None:
        if results.effects is None:
            return None
        rows = results.effects[(results.effects["user"] == user) & (results.effects["verdict"] == "effect")]
        return rows["kind"].tolist()

    return {
        "home": "",
        "pages": {"index": "Your table"},
        "facts": {"studies": []},
        "r": results,
        "score": score,
        "blind": lambda user: max(score(user, name, "accuracy") for name in BLIND),
        "reacts": reacts,
        "folds": FOLDS,
        "variant": VARIANT,
    }


def write_report(results: Results, out_dir: Path) -> None:
    """Replace the folder `out_dir` by the report: index.html, figures/, tables/ (csv and parquet), metrics.json."""
    site = render(results)
    part = out_dir.with_name(f".{out_dir.name}-part")
    shutil.rmtree(part, ignore_errors=True)
    write_files(site, part)
    for name, table in results.tables.items():
        write_table(part / "tables" / f"{name}.parquet", table)
    write_json(part / "metrics.json", results.metrics)
    write_recording(part / "recording.rrd", results)
    shutil.copy(SHARED / "page.css", part)
    old = out_dir.with_name(f".{out_dir.name}-old")
    shutil.rmtree(old, ignore_errors=True)
    if out_dir.exists():
        out_dir.rename(old)
    part.rename(out_dir)
    shutil.rmtree(old, ignore_errors=True)
