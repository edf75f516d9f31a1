"""Write the report on a folder: page, figures, tables, metrics; all of it or nothing."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artifacts.files import write_json, write_table
from pipeline.own.recording import write_recording
from pipeline.own.results import Results
from pipeline.report.page import FOLDER as SHARED
from pipeline.report.page import Site, environment, lookup, render_page, write_files


def write_report(results: Results, out_dir: Path) -> None:
    """Replace the folder `out_dir` by the report: index.html, figures/, tables/ (csv and parquet), metrics.json."""

    def score(user: str, predictor: str, column: str) -> float:
        return lookup(results.tables["scores"], "scores", column, user=user, predictor=predictor, share=1.0)

    site, shown = Site(), {"home": "", "pages": {"index": "Your table"}, "facts": {"studies": []}}
    made = environment(
        [Path(__file__).parent],
        r=results,
        score=score,
        folds=max(len(fitted.fold_models) for fitted in results.fitted.values()),
        **shown,
    )
    render_page("index", "page.html.j2", "pipeline.own", results, made, site)
    site.tables.update(results.tables)
    for name, table in site.tables.items():
        site.tables[name] = without_formulas(table)
    part, old = (out_dir.with_name(f".{out_dir.name}-{state}") for state in ("part", "old"))
    shutil.rmtree(part, ignore_errors=True)
    write_files(site, part)
    for name, table in results.tables.items():
        write_table(part / "tables" / f"{name}.parquet", table)
    write_json(part / "metrics.json", results.metrics)
    write_recording(part / "recording.rrd", results)
    shutil.copy(SHARED / "page.css", part)
    shutil.rmtree(old, ignore_errors=True)
    if out_dir.exists():
        out_dir.rename(old)
    part.rename(out_dir)
    shutil.rmtree(old, ignore_errors=True)


def without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table for csv whose texts no spreadsheet takes for a formula: ' stands before = + - @ tab and return."""

    def safe(value: object) -> object:
        return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value

    texts = [c for c in table.columns if not pd.api.types.is_numeric_dtype(table[c]) or table[c].dtype == object]
    return table.assign(**{str(column): table[column].map(safe) for column in texts}).replace({np.nan: None})
