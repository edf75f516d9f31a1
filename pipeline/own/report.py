"""Compute all results of a folder, and write its report: page, figures, tables, metrics; all of it or nothing."""

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artifacts.files import write_json, write_table
from pipeline.own import kinds, scoring
from pipeline.own.fitting import VARIANT, Fitted, UserData, fit_user
from pipeline.own.folder import Folder
from pipeline.own.frame import Frame
from pipeline.report.page import FOLDER as SHARED
from pipeline.report.page import Site, environment, lookup, render_page, write_files
from pipeline.runtime.errors import InputError

METRICS = "metrics.json"
HEADLINES = ["accuracy", "ci_low", "ci_high", "balanced", "missed", "calibration_error"]
CONTROL_POINTS = ["z_x", "z_y"], ["end_x", "end_y"]  # columns that hold places [m of the model]


@dataclass(frozen=True)
class Results:
    """What the page shows and the tables hold."""

    folder: Folder
    fitted: dict[str, Fitted]  # by user, in the order of their names
    added: dict[str, kinds.Added]  # by kind
    tables: dict[str, pd.DataFrame]  # with a row an observation, without those that the folder cannot fill
    unlisted: int  # detected objects that are not listed

    @property
    def metrics(self) -> dict:
        """Return the headlines: counts, and scores by user."""
        scores = self.tables["scores"].query("predictor == @VARIANT and share == 1").set_index("user")[HEADLINES]
        scores["gain_from_half"] = self.tables["enough"].set_index("user")["gain"]
        demos = self.tables["demonstrations"]
        counted: dict[str, float] = {"scenes": len(self.folder.scenes), "demonstrations": len(demos)}
        counted |= {"need_more_control_points": int(demos["needs_more"].sum())}
        if "detections" in self.tables:
            counted["recall"] = round(float(self.tables["detections"]["detected"].mean()), 6)
        return {"users": scores.astype(float).round(6).to_dict("index"), **counted}


def compute(folder: Folder, progress: Callable[[str], object]) -> Results:
    """Fit all users' models and return all results."""
    scale = folder.frame.scale
    fitted = {user: fit_user(UserData.of(user, folder), progress) for user in folder.users}

    def by_user(ask: Callable[[Fitted], pd.DataFrame]) -> pd.DataFrame:
        return pd.concat([ask(one) for one in fitted.values()], ignore_index=True)

    judged = by_user(lambda one: one.judged)
    tables = {
        "demonstrations": folder.demos,
        "predictions": judged,
        "scores": scoring.scores(judged),
        "reliability": scoring.calibration(judged),
        "enough": scoring.enough(judged, VARIANT),
        "disagreement": by_user(lambda one: scoring.disagreement(one, folder)),
    }
    progress("interventions")
    placed = {kind: kinds.add_kind(folder, kind) for kind in sorted(folder.cutouts)}
    added = {kind: places for kind, places in placed.items() if places is not None}
    if added:
        tables["interventions"] = by_user(lambda one: kinds.effects(one, added))
        tables["distances"] = by_user(lambda one: kinds.envelopes(one, added, folder, tables["interventions"]))
    progress("repairs")
    tables["repaired"] = by_user(lambda one: scoring.repairs(one, scale))
    unlisted = 0
    if folder.items is not None:
        tables["detections"], unlisted = folder.detected(folder.items)
    return Results(folder, fitted, added, tables, unlisted)


def check_replaceable(out_dir: Path) -> None:
    """Raise InputError unless `out_dir` is missing, empty or an earlier report."""
    if out_dir.exists() and not (out_dir / METRICS).is_file() and (out_dir.is_file() or any(out_dir.iterdir())):
        raise InputError(f"{out_dir} is not an earlier report, which would be replaced: move it away")


def write_report(results: Results, out_dir: Path) -> None:
    """Replace the folder `out_dir` by the report: index.html, figures/, tables/ (csv and parquet), metrics.json."""
    from pipeline.own.recording import write_recording  # reads Results

    def score(user: str, predictor: str, column: str) -> float:
        return lookup(results.tables["scores"], "scores", column, user=user, predictor=predictor, share=1.0)

    folds = max(len(fitted.fold_models) for fitted in results.fitted.values())
    site, shown = Site(), {"home": "", "pages": {"index": "Your table"}, "facts": {"studies": []}}
    made = environment([Path(__file__).parent], r=results, score=score, folds=folds, **shown)
    render_page("index", "page.html.j2", "pipeline.own", results, made, site)
    tables = {name: on_the_table(table, results.folder.frame) for name, table in results.tables.items()}
    site.tables.update(tables)
    site.tables.update({name: without_formulas(table) for name, table in site.tables.items()})
    part, old = (out_dir.with_name(f".{out_dir.name}-{state}") for state in ("part", "old"))
    shutil.rmtree(part, ignore_errors=True)
    write_files(site, part)
    for name, table in tables.items():
        write_table(part / "tables" / f"{name}.parquet", table)
    write_json(part / METRICS, results.metrics)
    write_recording(part / "recording.rrd", results)
    shutil.copy(SHARED / "page.css", part)
    shutil.rmtree(old, ignore_errors=True)
    if out_dir.exists():
        out_dir.rename(old)
    part.rename(out_dir)
    shutil.rmtree(old, ignore_errors=True)


def on_the_table(table: pd.DataFrame, frame: Frame) -> pd.DataFrame:
    """Return a table whose control points are in metres on the table, not the model's."""
    table = table.copy()
    for pair in CONTROL_POINTS:
        if pair[0] in table:
            table[pair] = frame.to_table(table[pair].to_numpy(float))
    return table


def without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table for csv whose texts no spreadsheet takes for a formula: ' stands before = + - @ tab and return."""

    def safe(value: object) -> object:
        return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value

    texts = table.select_dtypes(exclude=["number", "bool"]).columns
    return table.assign(**{str(column): table[column].map(safe) for column in texts}).replace({np.nan: None})
