"""Read and check demonstrations.csv, and fit a path of the models' to each demonstration.

The models take parabolas. A demonstration needs more if the parabola misses the hand by a pixel of the model's image.
"""

from collections.abc import Collection
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.models.base import Z_RANGE_M
from pipeline.own.csv_files import DEMONSTRATIONS, KEY, Faults, read_checked
from pipeline.own.frame import Frame
from pipeline.own.settings import ENDS_WITHIN_M, MIN_SAMPLES, MIN_SCENES, SETTINGS, Settings
from pipeline.world.bezier_fit import fit
from pipeline.world.hand import MAX_BEYOND_M
from pipeline.world.layout import SIDE

POOR_ABOVE_M = 1 / SIDE  # a pixel of the model's image [m]


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
    _check_demonstrations(samples, settings, faults)
    _check_users(samples.drop_duplicates(KEY), faults)
    return samples if len(faults) == before else None


def _check_demonstrations(samples: pd.DataFrame, settings: Settings, faults: Faults) -> None:
    """Add faults of whole demonstrations: labels, times, length, ends."""

    def check(rows: pd.DataFrame, wrong: pd.Series, sentence: str) -> None:
        faults.rows(DEMONSTRATIONS, rows[wrong], sentence)

    groups = samples.groupby(KEY, sort=False)
    samples = samples.assign(earlier=groups["t"].shift())
    first, last, side = groups.head(1), groups.tail(1), settings.side_m
    check(
        samples,
        samples["valid"] != groups["valid"].transform("first"),
        "valid changes within demonstration ({name}): expected one word for all of it",
    )
    check(
        samples,
        samples["t"] < samples["earlier"],
        "t goes back from {earlier:g} to {t:g} s in demonstration ({name}): expected times that increase, and a name "
        "of its own for each demonstration",
    )
    counted = first.assign(rows=groups.size().to_numpy())
    short = counted["rows"] < MIN_SAMPLES
    check(counted, short, f"demonstration ({{name}}) has {{rows}} rows: expected at least {MIN_SAMPLES}")
    for verb, end, rows in (("starts", "start", first), ("ends", "goal", last)):
        x, y = getattr(settings, end)
        rows = rows.assign(away=np.hypot(rows["x"] - x, rows["y"] - y))
        check(
            rows,
            rows["away"] > ENDS_WITHIN_M,
            f"demonstration ({{name}}) {verb} at ({{x:.3g}}, {{y:.3g}}) m, {{away:.2g}} m from the {end} ({x:g}, {y:g})"
            f": expected at most {ENDS_WITHIN_M:g} m; positions are in metres, and {SETTINGS} sets the {end}",
        )
    far = ((samples[["x", "y"]] - side / 2).abs() > (0.5 + MAX_BEYOND_M) * side).any(axis=1)
    check(samples, far, f"the path is at ({{x:g}}, {{y:g}}) m, far off the table: expected metres from 0 to {side:g}")


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


def fit_demonstrations(samples: pd.DataFrame, frame: Frame, faults: Faults) -> pd.DataFrame:
    """Return one row for each demonstration of `demonstrations.read_samples`, sorted by scene, user and demo.

    Columns: scene, user, demo, valid, z_x, z_y (control point in the model's metres), residual_m (root mean square
    distance from the path, metres on the table) and needs_more. Adds a fault for paths out of the models' range.
    """
    offsets = np.append(np.flatnonzero(~samples.duplicated(KEY)), len(samples))
    points = frame.to_model(samples[["x", "y"]].to_numpy())
    fits = fit(points, offsets, poor_above_m=POOR_ABOVE_M)
    demos = samples.iloc[offsets[:-1]]
    far = demos[(np.abs(fits.z_theta - np.mean(Z_RANGE_M)) > np.ptp(Z_RANGE_M) / 2).any(axis=1)]
    faults.rows(
        DEMONSTRATIONS, far, "demonstration ({name}) swings out farther than the models' paths can: leave it out"
    )
    demos = demos[[*KEY, "valid"]].reset_index(drop=True)
    demos[["z_x", "z_y"]] = fits.z_theta
    demos["residual_m"] = fits.residual_m / frame.scale
    demos["needs_more"] = fits.poor
    return demos
