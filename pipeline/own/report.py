"""Write the report of a folder: page, figures, tables, metrics; all of it or nothing."""

import shutil
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artifacts.files import write_json, write_table
from pipeline.own import figures
from pipeline.own.curves import CONTROLS
from pipeline.own.export import write_exports
from pipeline.own.frame import Frame
from pipeline.own.results import Results
from pipeline.report.page import FOLDER as SHARED
from pipeline.report.page import Site, environment, render_page, write_files
from pipeline.report.tables import lookup
from pipeline.runtime.errors import InputError

METRICS = "metrics.json"


def check_replaceable(out_dir: Path) -> None:
    """Raise InputError unless `out_dir` is missing, empty or an earlier report."""
    if out_dir.exists() and not (out_dir / METRICS).is_file() and (out_dir.is_file() or any(out_dir.iterdir())):
        raise InputError(f"{out_dir} is not an earlier report, which would be replaced: move it away")


def write_report(results: Results, out_dir: Path) -> None:
    """Replace the folder `out_dir` by the report: page, figures, tables, metrics, exports."""

    def score(user: str, predictor: str, column: str) -> float:
        return lookup(results.tables["scores"], "scores", column, user=user, predictor=predictor, share=1.0)

    def helped(user: str) -> str:
        return lookup(results.tables["seeing"], "seeing", "state", user=user)

    folds = max(len(fitted.fold_models) for fitted in results.fitted.values())
    site, shown = Site(), {"home": "", "pages": {"index": "Your table"}, "facts": {"studies": []}}
    made = environment([Path(__file__).parent], r=results, score=score, helped=helped, folds=folds, **shown)
    render_page("index", "page.html.j2", figures, results, made, site)
    tables = {name: on_the_table(table, results.folder.frame) for name, table in results.tables.items()}
    site.tables.update(tables)
    for name, table in site.tables.items():  # no spreadsheet should take a text for a formula: ' stands before it
        site.tables[name] = table.replace(r"^(?=[=+\-@\t\r])", "'", regex=True).replace({np.nan: None})
    part, old = (out_dir.with_name(f".{out_dir.name}-{state}") for state in ("part", "old"))
    shutil.rmtree(part, ignore_errors=True)
    write_files(site, part)
    for name, table in tables.items():
        write_table(part / "tables" / f"{name}.parquet", table)
    write_json(part / METRICS, results.metrics)
    write_exports(results, part)
    shutil.copy(SHARED / "page.css", part)
    shutil.rmtree(old, ignore_errors=True)
    if out_dir.exists():
        out_dir.rename(old)
    part.rename(out_dir)
    shutil.rmtree(old, ignore_errors=True)


def on_the_table(table: pd.DataFrame, frame: Frame) -> pd.DataFrame:
    """Return a table whose control points, if it has any, are in metres on the table, not the model's."""
    return table.assign(**(table.filter(regex=CONTROLS) / frame.scale))
