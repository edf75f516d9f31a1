"""Read and check demonstrations.csv of a person's folder."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.own.csv_files import Faults, check_names, numbers, read_csv, row_numbers
from pipeline.own.settings import SETTINGS, Settings
from pipeline.runtime.errors import InputError
from pipeline.world.hand import MAX_BEYOND_M

DEMONSTRATIONS = "demonstrations.csv"
KEY = ["scene", "user", "demo"]
ENDS_WITHIN_M = 0.05  # largest distance of a path's ends from start and goal [m]; a hand that is not in a hurry
MIN_SAMPLES = 3  # rows of a demonstration
MIN_SCENES = 4  # scenes of a user: fewer leave nothing to fit on and nothing to judge by


def read_samples(path: Path, scenes: Mapping[str, Path], settings: Settings, faults: Faults) -> pd.DataFrame | None:
    """Return the samples of all demonstrations, sorted by demonstration and in their own order; None after a fault."""
    file, before = DEMONSTRATIONS, len(faults)
    if not (path / file).is_file():
        faults.append(f"{file} is missing: draw paths with `python -m pipeline.own record {path}`, or write it")
        return None
    try:
        text = read_csv(path / file, [*KEY, "t", "x", "y", "valid"])
    except InputError as error:
        faults.append(str(error))
        return None
    if text.empty:
        faults.append(f"{file} has no row below its header: expected demonstrations")
        return None
    check_names(text, KEY, file, faults)
    names = text["scene"].tolist()
    faults.rows(
        file,
        ~text["scene"].isin(scenes.keys()).to_numpy(),
        lambda i: f"scene {names[i]!r} has no picture in scenes/: add it, or correct the name",
        row_numbers(text),
    )
    made = numbers(text, ["t", "x", "y"], file, faults)
    words = text["valid"].str.lower()
    faults.rows(
        file,
        ~words.isin(["true", "false"]).to_numpy(),
        lambda i: f"valid is {text['valid'].iloc[i]!r}: expected true or false",
        row_numbers(text),
    )
    if len(faults) > before:
        return None
    samples = pd.concat([text[KEY], made], axis=1).assign(valid=words == "true", row=row_numbers(text))
    samples = samples.sort_values(KEY, kind="stable", ignore_index=True)
    _check_demonstrations(samples, settings, faults)
    _check_users(samples, faults)
    return samples if len(faults) == before else None


def _check_demonstrations(samples: pd.DataFrame, settings: Settings, faults: Faults) -> None:
    """Add faults of whole demonstrations: labels, length, times, ends."""
    file, rows = DEMONSTRATIONS, samples["row"].to_numpy()
    number = samples.groupby(KEY, sort=False).ngroup().to_numpy()
    first, last = np.flatnonzero(np.diff(number, prepend=-1)), np.flatnonzero(np.diff(number, append=-1))
    names = [", ".join(key) for key in samples.loc[first, KEY].itertuples(index=False)]
    same = np.diff(number, prepend=-1) == 0
    t, x, y, valid = (samples[name].to_numpy() for name in ("t", "x", "y", "valid"))
    faults.rows(
        file,
        same & (valid != np.roll(valid, 1)),
        lambda i: f"valid changes within demonstration ({names[number[i]]}): expected one word for all of it",
        rows,
    )
    back = same & (t < np.roll(t, 1))
    faults.rows(
        file,
        back,
        lambda i: (
            f"t goes back from {t[i - 1]:g} to {t[i]:g} s in demonstration ({names[number[i]]}): expected times that "
            "increase, and a name of its own for each demonstration"
        ),
        rows,
    )
    length = last - first + 1
    faults.rows(
        file,
        length < MIN_SAMPLES,
        lambda i: f"demonstration ({names[i]}) has {length[i]} rows: expected at least {MIN_SAMPLES}",
        rows[first],
    )
    points = np.stack([x, y], -1)
    for verb, ends, place in (("starts", first, settings.start), ("ends", last, settings.goal)):
        away = np.linalg.norm(points[ends] - place, axis=1)
        goal = "start" if verb == "starts" else "goal"
        faults.rows(
            file,
            away > ENDS_WITHIN_M,
            lambda i, verb=verb, ends=ends, place=place, away=away, goal=goal: (
                f"demonstration ({names[i]}) {verb} at ({x[ends[i]]:.3g}, {y[ends[i]]:.3g}) m, {away[i]:.2g} m from "
                f"the {goal} ({place[0]:g}, {place[1]:g}): expected at most {ENDS_WITHIN_M:g} m; positions are in "
                f"metres, and {SETTINGS} sets the {goal}"
            ),
            rows[ends],
        )
    beyond = np.maximum(-points, points - settings.side_m).max(1)
    faults.rows(
        file,
        beyond > MAX_BEYOND_M * settings.side_m,
        lambda i: (
            f"the path is at ({x[i]:g}, {y[i]:g}) m, far off the table: expected metres from 0 to {settings.side_m:g}"
        ),
        rows,
    )


def _check_users(samples: pd.DataFrame, faults: Faults) -> None:
    """Add a fault for each user with too few scenes or with labels of one kind."""
    demos = samples.drop_duplicates(KEY)
    for user, rows in demos.groupby("user"):
        scenes, row = rows["scene"].nunique(), rows["row"].min()
        if scenes < MIN_SCENES:
            faults.append(
                f"{DEMONSTRATIONS}, row {row}: user {user} has {scenes} scenes: expected at least {MIN_SCENES}; add "
                "demonstrations, or leave the user out"
            )
        if rows["valid"].nunique() == 1:
            word = "valid" if rows["valid"].iloc[0] else "invalid"
            faults.append(
                f"{DEMONSTRATIONS}, row {row}: all {len(rows)} demonstrations of user {user} are {word}: expected both "
                "valid and invalid ones; add the other kind, or leave the user out"
            )
