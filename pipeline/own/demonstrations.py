"""Read and check demonstrations.csv; the recorder checks what a person draws by the same rules."""

import shlex
from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray as Array

from pipeline.own.files import DEMONSTRATIONS, KEY, Faults, Settings, read_checked

MAX_BEYOND_M = 0.5  # largest distance of the hand beyond the table's edge, over its longer side
MIN_SAMPLES = 5  # rows of a demonstration: enough for a curve if they lie well apart
MAX_SPEED_M_S = 9.0  # our choice, on a table of up to 1 m: from corner to corner in 0.16 s, where nobody shows a path
CLOCK_S = 0.01  # what a step's times may be off by
STILL, LOST = 0.001, 0.05  # shorter steps are rest; longer ones may be a lost tracker's; relative to the table's side
FROZEN_ROWS, CATCH_UP, TELEPORT = 3, 2, 5  # rows at rest; times the usual of the step after it, and of any step
LONE, BESIDE, BRIEF_S = 3, (-2, -1, 1, 2), 0.1  # times the median of the steps beside it: no brief step of a hand is so
MIN_SCENES = 4  # scenes of a user: fewer leave nothing to fit on and nothing to judge by


def read_samples(path: Path, scenes: Collection[str], settings: Settings, faults: Faults) -> pd.DataFrame | None:
    """Return the samples of all labelled demonstrations, sorted by these, each in its own order; None after a fault.

    Columns: scene, user, demo, t [s], x, y [m on the table], valid, and `name` with scene, user and demo; rows are
    numbered as in the file.
    """
    file, before, record = DEMONSTRATIONS, len(faults), f"`python -m pipeline.own record {shlex.quote(str(path))}`"
    if not (path / file).is_file():
        faults.append(f"{file} is missing: draw paths with {record}, or write it")
        return None
    samples = read_checked(path / file, scenes, faults)
    if samples is not None and samples.empty:
        faults.append(f"{file} has no row below its header: expected demonstrations")
    if samples is not None:
        judged = samples.groupby(KEY)["valid"].transform("max") != ""
        half = "valid is empty, but not in all rows of demonstration ({scene}, {user}, {demo}): write the word in all"
        faults.rows(file, samples[judged & (samples["valid"] == "")], half)
    if samples is None or len(faults) > before:
        return None
    if count := len(bare := samples[samples["valid"] == ""].drop_duplicates(KEY)):
        judge = f"judge them with {record}, or write true or false"
        if count == len(samples.drop_duplicates(KEY)):
            faults.append(f"{file}, row {bare.index[0]}: no demonstration has a label: {judge}")
            return None
        faults.notes.append(f"demonstrations without a label, left out: {count}; {judge}")
        samples = samples[samples["valid"] != ""]
    valid, name = samples["valid"].str.lower() == "true", samples["scene"].str.cat(samples[KEY[1:]], sep=", ")
    samples = samples.assign(valid=valid, name=name).sort_values(KEY, kind="stable")
    check_paths(samples, settings, faults)
    for user, rows in samples.drop_duplicates(KEY).groupby("user"):
        where, count = f"{file}, row {rows.index.min()}:", rows["scene"].nunique()
        if count < MIN_SCENES:
            few = f"has {count} scenes: expected at least {MIN_SCENES}"
            faults.append(f"{where} user {user} {few}; add demonstrations, or leave the user out")
        if rows["valid"].nunique() == 1:
            alike = f"user {user} has {'' if rows['valid'].iloc[0] else 'in'}valid demonstrations alone"
            faults.append(f"{where} {alike}: expected both; add the other kind, or leave the user out")
    return samples if len(faults) == before else None


def check_paths(samples: pd.DataFrame, settings: Settings, faults: Faults) -> None:
    """Add faults of whole demonstrations: labels, times, rows, movement; samples: as of `read_samples`."""
    file, groups, size = DEMONSTRATIONS, samples.groupby(KEY, sort=False), settings.size_m
    samples = samples.assign(earlier=groups["t"].shift())
    changes, back = samples["valid"] != groups["valid"].transform("first"), samples["t"] < samples["earlier"]
    faults.rows(file, samples[changes], "valid changes within demonstration ({name}): expected one word for all of it")
    increasing = "expected times that increase, and a name of its own for each demonstration"
    goes = "t goes back from {earlier:g} to {t:g} s in demonstration ({name})"
    faults.rows(file, samples[back], f"{goes}: {increasing}")
    extent = np.hypot(*(groups[["x", "y"]].max() - groups[["x", "y"]].min()).to_numpy().T)
    counted = groups.head(1).assign(rows=groups.size().to_numpy(), extent=extent)
    short = f"demonstration ({{name}}) has {{rows}} rows: expected at least {MIN_SAMPLES}"
    faults.rows(file, counted[counted["rows"] < MIN_SAMPLES], short)
    resting = "demonstration ({name}) stays within {extent:.1g} m: expected a path in metres, or leave it out"
    faults.rows(file, counted[counted["extent"] <= STILL * size.max()], resting)
    _check_motion(samples, size.max(), faults)
    off = ((samples[["x", "y"]] - size / 2).abs() > size / 2 + MAX_BEYOND_M * size.max()).any(axis=1)
    metres = f"far off the table: expected metres from 0 to {size[0]:g} and {size[1]:g}"
    faults.rows(file, samples[off], f"the path is at ({{x:g}}, {{y:g}}) m, {metres}")


def _check_motion(samples: pd.DataFrame, side: float, faults: Faults) -> None:
    """Add faults of paths that no hand makes: lost and frozen trackers, several recordings under one name."""
    groups, places = samples.groupby(KEY, sort=False), ["x", "y"]
    number, seconds = groups.ngroup(), groups["t"].diff()
    step, across = (np.hypot(*groups[places].diff(rows).to_numpy().T) for rows in (1, 2))
    step, across = pd.Series(step, samples.index), pd.Series(across, samples.index).groupby(number).shift(-1)
    stays = (~(step <= STILL * side)).cumsum()  # numbers the runs of rows at one place, in one demonstration
    held = stays.groupby(stays).transform("size").shift().where(step.notna(), 0)  # rows at the place before
    speed = step / (seconds.clip(lower=0) + CLOCK_S)
    usual = speed.where((step > STILL * side) & (held < FROZEN_ROWS)).groupby(number).transform("quantile", 0.75)
    faster = (speed / usual.fillna(0)).where(step > LOST * side, 0)  # than the demonstration's usual steps
    longer = step / step.where(step > STILL * side).groupby(number).transform("quantile", 0.75)  # than its usual steps
    beside = pd.concat([speed.groupby(number).shift(rows) for rows in BESIDE], axis=1)
    gap = (seconds > 0) & (step > LOST * side) & (longer > TELEPORT) & ~(faster > TELEPORT)
    returns = np.minimum(faster, faster.groupby(number).shift(-1)) > CATCH_UP
    lone = (speed > LONE * beside.median(axis=1)) & (step > LOST * side) & (longer > CATCH_UP) & (seconds < BRIEF_S)
    teleport = (faster > TELEPORT) | lone & ~gap & ~returns
    frozen = (held >= FROZEN_ROWS) & (faster > CATCH_UP)
    lost = (samples[places] == 0).all(axis=1) & (step > LOST * side)
    samples = samples.assign(step=step, seconds=seconds, held=held)
    wrong = {
        "jumps by {step:.2g} m in {seconds:g} s: remove samples that were lost, and name each recording differently": (
            (seconds >= 0) & ((speed > MAX_SPEED_M_S * max(side, 1)) | teleport & (held < FROZEN_ROWS))
        ),
        "stands still for {held:g} rows and then jumps by {step:.2g} m: remove the rows of a frozen tracker": frozen,
        "leaves its path for one row, to ({x:g}, {y:g}) m: remove samples that were lost": returns & (across < step),
        "is at (0, 0), where lost samples are logged: remove these rows": lost,
        "has a gap of {step:.2g} m: give each recording a name of its own, or leave this one out": gap,
    }
    for sentence, rows in wrong.items():
        faults.rows(DEMONSTRATIONS, samples[rows], f"demonstration ({{name}}) {sentence}")


def thinned(t: Float[Array, " n"], step: float) -> Int[Array, " kept"]:
    """Return the indices of the first sample in each `step` of time, and of the last; all where this leaves too few."""
    kept = np.unique(np.floor((t - t[0]) / step + 1e-3), return_index=True)[1]  # robust to rounded times
    return np.append(kept[:-1], len(t) - 1) if len(kept) >= MIN_SAMPLES else np.arange(len(t))
