"""Read and check demonstrations.csv; the recorder checks what a person draws by the same rules."""

from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.own.files import DEMONSTRATIONS, KEY, SETTINGS, Faults, Settings, read_checked

ENDS_WITHIN_M = 0.05  # largest distance of a path's ends from start and goal [m]; a hand that is not in a hurry
MAX_BEYOND_M = 0.5  # largest distance of the hand beyond the table's edge, on a table of 1 m
MIN_SAMPLES = 4  # rows of a demonstration: its ends, and two that determine a parabola if they lie well apart
MAX_SPEED_M_S = 9.0  # our choice, on a table of up to 1 m: from corner to corner in 0.16 s, where nobody shows a path
CLOCK_S = 0.01  # what a step's times may be off by
STILL, LOST = 0.001, 0.05  # shorter steps are rest; longer ones may be a lost tracker's; relative to the table's side
FROZEN_ROWS, CATCH_UP, TELEPORT = 3, 2, 5  # rows at rest; how many times faster than usual the step after them, or any
MIN_SCENES = 4  # scenes of a user: fewer leave nothing to fit on and nothing to judge by


def read_samples(path: Path, scenes: Collection[str], settings: Settings, faults: Faults) -> pd.DataFrame | None:
    """Return the samples of all demonstrations, sorted by demonstration and in their own order; None after a fault.

    Columns: scene, user, demo, t [s], x, y [m on the table], valid, and `name` with scene, user and demo; rows are
    numbered as in the file.
    """
    file, before = DEMONSTRATIONS, len(faults)
    if not (path / file).is_file():
        faults.append(f"{file} is missing: draw paths with `python -m pipeline.own record {path}`, or write it")
        return None
    samples = read_checked(path / file, scenes, faults)
    if samples is not None and samples.empty:
        faults.append(f"{file} has no row below its header: expected demonstrations")
    if samples is None or len(faults) > before:
        return None
    valid, name = samples["valid"].str.lower() == "true", samples["scene"].str.cat(samples[KEY[1:]], sep=", ")
    samples = samples.assign(valid=valid, name=name).sort_values(KEY, kind="stable")
    check_paths(samples, settings, faults)
    for user, rows in samples.drop_duplicates(KEY).groupby("user"):
        where, count = f"{file}, row {rows.index.min()}:", rows["scene"].nunique()
        if count < MIN_SCENES:
            few = f"has {count} scenes: expected at least {MIN_SCENES}"
            faults.append(f"{where} user {user} {few}; add demonstrations, or leave the user out")
        if rows["valid"].nunique() == 1:
            alike = f"all {len(rows)} demonstrations of user {user} are {'' if rows['valid'].iloc[0] else 'in'}valid"
            faults.append(f"{where} {alike}: expected both; add the other kind, or leave the user out")
    return samples if len(faults) == before else None


def check_paths(samples: pd.DataFrame, settings: Settings, faults: Faults) -> None:
    """Add faults of whole demonstrations: labels, times, length, ends; samples: as `read_samples` returns them."""

    file, groups, side = DEMONSTRATIONS, samples.groupby(KEY, sort=False), settings.side_m
    samples = samples.assign(earlier=groups["t"].shift())
    changes, back = samples["valid"] != groups["valid"].transform("first"), samples["t"] < samples["earlier"]
    faults.rows(file, samples[changes], "valid changes within demonstration ({name}): expected one word for all of it")
    increasing = "expected times that increase, and a name of its own for each demonstration"
    goes = "t goes back from {earlier:g} to {t:g} s in demonstration ({name})"
    faults.rows(file, samples[back], f"{goes}: {increasing}")
    counted = groups.head(1).assign(rows=groups.size().to_numpy())
    short = f"demonstration ({{name}}) has {{rows}} rows: expected at least {MIN_SAMPLES}"
    faults.rows(file, counted[counted["rows"] < MIN_SAMPLES], short)
    for verb, end, rows in (("starts", "start", groups.head(1)), ("ends", "goal", groups.tail(1))):
        x, y = getattr(settings, end)
        rows = rows.assign(away=np.hypot(rows["x"] - x, rows["y"] - y))
        place = f"{verb} at ({{x:.3g}}, {{y:.3g}}) m, {{away:.2g}} m from the {end} ({x:g}, {y:g})"
        unit = f"positions are in metres, and {SETTINGS} sets the {end}"
        far = f"demonstration ({{name}}) {place}: expected at most {ENDS_WITHIN_M:g} m; {unit}"
        faults.rows(file, rows[rows["away"] > ENDS_WITHIN_M], far)
    _check_motion(samples, settings, faults)
    off = ((samples[["x", "y"]] - side / 2).abs() > (0.5 + MAX_BEYOND_M) * side).any(axis=1)
    far = f"the path is at ({{x:g}}, {{y:g}}) m, far off the table: expected metres from 0 to {side:g}"
    faults.rows(file, samples[off], far)


def _check_motion(samples: pd.DataFrame, settings: Settings, faults: Faults) -> None:
    """Add faults of paths that no hand makes: lost and frozen trackers, several recordings under one name."""
    groups, places, side = samples.groupby(KEY, sort=False), ["x", "y"], settings.side_m
    number, seconds = groups.ngroup(), groups["t"].diff()
    step, across = (np.hypot(*groups[places].diff(rows).to_numpy().T) for rows in (1, 2))
    step, across = pd.Series(step, samples.index), pd.Series(across, samples.index).groupby(number).shift(-1)
    stays = (~(step <= STILL * side)).cumsum()  # numbers the runs of rows at one place, in one demonstration
    held = stays.groupby(stays).transform("size").shift().where(step.notna(), 0)  # rows at the place before
    speed = step / (seconds.clip(lower=0) + CLOCK_S)
    usual = speed.where((step > STILL * side) & (held < FROZEN_ROWS)).groupby(number).transform("quantile", 0.75)
    faster = (speed / usual.fillna(0)).where(step > LOST * side, 0)  # than the demonstration's usual steps
    away_and_back = np.minimum(faster, faster.groupby(number).shift(-1)) > CATCH_UP
    near = min(ENDS_WITHIN_M, np.hypot(*(settings.goal - settings.start)) / 3)
    at_start, at_goal = (
        np.hypot(*(samples[places] - end).to_numpy().T) < near for end in (settings.start, settings.goal)
    )
    is_corner = np.hypot(*np.transpose([settings.start, settings.goal])).min() < ENDS_WITHIN_M
    samples = samples.assign(step=step, seconds=seconds, held=held)
    wrong = {
        "jumps by {step:.2g} m in {seconds:g} s: remove samples that were lost, and name each recording differently": (
            (seconds >= 0) & ((speed > MAX_SPEED_M_S * max(side, 1)) | (faster > TELEPORT) & (held < FROZEN_ROWS))
        ),
        "stands still for {held:g} rows and then jumps by {step:.2g} m: remove the rows of a frozen tracker": (
            (held >= FROZEN_ROWS) & (faster > CATCH_UP)
        ),
        "leaves its path for one row, to ({x:g}, {y:g}) m: remove samples that were lost": (
            away_and_back & (across < step)
        ),
        "is at (0, 0), where lost samples are logged: remove these rows": (
            (samples[places] == 0).all(axis=1) & (not is_corner)
        ),
        "is back at the start after it was at the goal: give each recording a name of its own": (
            at_start & pd.Series(at_goal, samples.index).groupby(number).cummax()
        ),
    }
    for sentence, rows in wrong.items():
        faults.rows(DEMONSTRATIONS, samples[rows], f"demonstration ({{name}}) {sentence}")
