"""Read and check demonstrations.csv of a person's folder."""

from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.own.csv_files import DEMONSTRATIONS, KEY, Faults, read_checked
from pipeline.own.settings import SETTINGS, Settings
from pipeline.world.hand import MAX_BEYOND_M

ENDS_WITHIN_M = 0.05  # largest distance of a path's ends from start and goal [m]; a hand that is not in a hurry
MIN_SAMPLES = 3  # rows of a demonstration
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
    if samples is None:
        return None
    if samples.empty:
        faults.append(f"{file} has no row below its header: expected demonstrations")
        return None
    words = samples["valid"].str.lower()
    faults.cells(file, samples.loc[~words.isin(["true", "false"]), "valid"], "true or false")
    if len(faults) > before:
        return None
    samples = samples.assign(valid=words == "true", name=samples["scene"].str.cat(samples[KEY[1:]], sep=", "))
    samples = samples.sort_values(KEY, kind="stable")
    _check_demonstrations(samples, settings, faults)
    _check_users(samples.drop_duplicates(KEY), faults)
    return samples if len(faults) == before else None


def _check_demonstrations(samples: pd.DataFrame, settings: Settings, faults: Faults) -> None:
    """Add faults of whole demonstrations: labels, times, length, ends."""
    file, groups = DEMONSTRATIONS, samples.groupby(KEY, sort=False)
    changed = samples[samples["valid"] != groups["valid"].transform("first")]
    faults.rows(file, changed, "valid changes within demonstration ({name}): expected one word for all of it")
    timed = samples.assign(earlier=groups["t"].shift())
    faults.rows(
        file,
        timed[timed["t"] < timed["earlier"]],
        "t goes back from {earlier:g} to {t:g} s in demonstration ({name}): expected times that increase, and a name "
        "of its own for each demonstration",
    )
    counted = groups.head(1).assign(rows=groups.size().to_numpy())
    short = counted[counted["rows"] < MIN_SAMPLES]
    faults.rows(file, short, f"demonstration ({{name}}) has {{rows}} rows: expected at least {MIN_SAMPLES}")
    for verb, end, rows in (("starts", "start", groups.head(1)), ("ends", "goal", groups.tail(1))):
        place = getattr(settings, end)
        rows = rows.assign(away=np.hypot(rows["x"] - place[0], rows["y"] - place[1]))
        faults.rows(
            file,
            rows[rows["away"] > ENDS_WITHIN_M],
            "demonstration ({name}) {verb} at ({x:.3g}, {y:.3g}) m, {away:.2g} m from the {end} ({place[0]:g}, "
            f"{{place[1]:g}}): expected at most {ENDS_WITHIN_M:g} m; positions are in metres, and {SETTINGS} sets the "
            "{end}",
            verb=verb,
            end=end,
            place=place,
        )
    beyond = np.maximum(-samples[["x", "y"]], samples[["x", "y"]] - settings.side_m).max(axis=1)
    far = samples[beyond > MAX_BEYOND_M * settings.side_m]
    expected = f"expected metres from 0 to {settings.side_m:g}"
    faults.rows(file, far, "the path is at ({x:g}, {y:g}) m, far off the table: " + expected)


def _check_users(demos: pd.DataFrame, faults: Faults) -> None:
    """Add a fault for each user with too few scenes or with labels of one kind."""
    for user, rows in demos.groupby("user"):
        where, scenes = f"{DEMONSTRATIONS}, row {rows.index.min()}:", rows["scene"].nunique()
        if scenes < MIN_SCENES:
            faults.append(
                f"{where} user {user} has {scenes} scenes: expected at least {MIN_SCENES}; add demonstrations, or "
                "leave the user out"
            )
        if rows["valid"].nunique() == 1:
            word = "valid" if rows["valid"].iloc[0] else "invalid"
            faults.append(
                f"{where} all {len(rows)} demonstrations of user {user} are {word}: expected both valid and invalid "
                "ones; add the other kind, or leave the user out"
            )
