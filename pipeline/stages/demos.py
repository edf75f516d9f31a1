"""Stage demos: record demonstrations of every user, fit Bezier paths to them, and draw the query paths."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
from numpy import ndarray as Array
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import DEMO_KEY, Queries, write_demos, write_queries
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from pipeline.runtime.reading import read_csv
from pipeline.runtime.settings import (
    MAX_N,
    Count,
    Demonstrations,
    Distance,
    Group,
    Length,
    Pair,
    Size,
    Spread,
    Whole,
    need,
)
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta
from pipeline.world.bezier_fit import fit
from pipeline.world.clear_cases import Candidates
from pipeline.world.hand import Hand, check, join, simulate, valid_trajectories
from pipeline.world.layout import Layouts
from pipeline.world.rules import slack, valid

DRAWS_PER_CLEAR_PATH = 20  # random paths of which one clear of the boundary is kept

Key = tuple[int, str, int, int]  # seed, user, scene, demo


@dataclass(frozen=True)
class Recorded:
    """Concatenated trajectories in the order of their keys, and each one's offset."""

    keys: pd.DataFrame
    samples: Array  # (total, 4) t [s], x, y, z [m], rounded to the stored float32
    offsets: Array  # (trajectory + 1,)


class HandSettings(Group):
    rate_hz: Size
    jitter_s: Spread
    speed_m_s: Size
    speed_spread: Spread
    tremor_m: Distance
    tremor_hz: Pair
    drift_m: Distance
    height_m: float
    height_drift_m: Distance


class Settings(Group):
    root_seed: Whole
    per_scene: Demonstrations
    queries_seen: Count
    queries_new: Count
    clear_m: Distance
    recorded: str | None
    ends_within_m: Length
    poor_above_m: Length
    hand: HandSettings


def agree(demos: Settings, parameters: Any) -> None:
    """Require demonstrations enough for each number that is fitted, and a band of tremor."""
    least = f"a whole number from max(n_demos) = {max(parameters.n_demos)} to {MAX_N}"
    need(demos.per_scene >= max(parameters.n_demos), "demos.per_scene", demos.per_scene, least)
    low, high = demos.hand.tremor_hz
    band = "a band above 0, the lower end first, below half of rate_hz"
    need(0 < low <= high < demos.hand.rate_hz / 2, "demos.hand.tremor_hz", demos.hand.tremor_hz, band)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write demos.parquet, trajectories.npz and queries.npz."""
    from_csv = _read_trajectories(cfg)
    scenes = read_scenes(Path(cfg.paths.scenes))
    scenes.check_has(*map(train_pool, [*cfg.seeds, *cfg.validation_seeds]))
    layouts = scenes.layouts
    recorded = _record(cfg, layouts, from_csv)
    fits = fit(recorded.samples[:, 1:3], recorded.offsets, cfg.demos.poor_above_m)
    demos = recorded.keys.assign(
        z_x=fits.z_theta[:, 0],
        z_y=fits.z_theta[:, 1],
        valid=_label(cfg, layouts, recorded),
        residual_m=fits.residual_m,
        poor_fit=fits.poor,
        duration_s=recorded.samples[recorded.offsets[1:] - 1, 0] - recorded.samples[recorded.offsets[:-1], 0],
        samples=np.diff(recorded.offsets),
    )
    queries = {pool: _queries(cfg, pool, layouts[pool]) for pool in sorted(layouts)}
    write_demos(out_dir, demos, recorded.samples, recorded.offsets)
    write_queries(out_dir, queries)


def _record(cfg: DictConfig, layouts: dict[str, Layouts], from_csv: dict[Key, Array]) -> Recorded:
    """Return the trajectory of each demonstration, simulated or a person's, after checking it.

    InputError if one of `from_csv` belongs to no demonstration.
    """
    hand = Hand.of(cfg.demos.hand)
    keys = [
        (seed, user, scene, demo)
        for seed in sorted([*cfg.seeds, *cfg.validation_seeds])
        for user in sorted(cfg.users)
        for scene in range(len(layouts[train_pool(seed)]))
        for demo in range(cfg.demos.per_scene)
    ]
    known = set(keys)
    if unknown := next((key for key in from_csv if key not in known), None):
        raise InputError(
            f"{cfg.demos.recorded}: trajectory (seed, user, scene, demo) = {unknown} belongs to no demonstration; "
            "expected seeds, users, scenes and demos of conf/; correct or remove it"
        )
    if from_csv:
        print(f"{len(from_csv)} of {len(keys)} demonstrations are a person's, from {cfg.demos.recorded}", flush=True)
    clear = _clear_demonstrations(cfg, layouts) if cfg.demos.clear_m else {}
    trajectories = []
    for key in tqdm(keys, desc="demos"):
        rng = _generator(cfg, "recording", *key)
        z_theta = clear[key[:2]][key[2:]] if clear else random_z_theta(rng)
        trajectory = from_csv[key] if key in from_csv else simulate(rng, z_theta, hand)
        check(trajectory, "seed {} user {} scene {} demo {}".format(*key), cfg.demos.ends_within_m)
        since_start = trajectory - [trajectory[0, 0], 0.0, 0.0, 0.0]  # float32 cannot represent absolute clock times
        trajectories.append(since_start.astype(np.float32).astype(float))
    return Recorded(pd.DataFrame(keys, columns=DEMO_KEY), *join(trajectories))


def _clear_demonstrations(cfg: DictConfig, layouts: dict[str, Layouts]) -> dict[tuple[int, str], Array]:
    """Return the paths (scene, demo, 2) [m] that each seed's users mean to show: clear of their own boundary."""
    return {
        (seed, user): _clear_paths(cfg, layouts[train_pool(seed)], cfg.demos.per_scene, [user], seed, user)
        for seed in (*cfg.seeds, *cfg.validation_seeds)
        for user in cfg.users
    }


def _clear_paths(cfg: DictConfig, layouts: Layouts, count: int, users: Collection[str], *names: str | int) -> Array:
    """Draw random paths (scene, count, 2) [m] at least `demos.clear_m` from these users' boundaries of validity.

    InputError if a scene has too few.
    """
    rng = _generator(cfg, "clear", *names)
    candidates = Candidates.of(layouts, random_z_theta(rng, len(layouts), count * DRAWS_PER_CLEAR_PATH))
    slacks = np.stack([slack(layouts, candidates.clearances, cfg.users[user]) for user in users])
    near = (np.abs(slacks) < cfg.demos.clear_m).any(0)  # (scene, candidate)
    few = int((~near).sum(1).min())
    at = f"a distance at which each scene has {count} paths: one has {few}"
    need(few >= count, "demos.clear_m", cfg.demos.clear_m, at)
    first = np.argsort(near, axis=1, kind="stable")[:, :count]  # the clear ones, in the order drawn
    return np.take_along_axis(candidates.z_theta, first[..., None], 1)


def _read_trajectories(cfg: DictConfig) -> dict[Key, Array]:
    """Return the trajectories of the csv `demos.recorded` by key, unchecked; none without a csv."""
    if cfg.demos.recorded is None:
        return {}
    path, columns = Path(cfg.demos.recorded), ["t", "x", "y", "z"]
    known = path.resolve().is_relative_to(Path(cfg.paths.data).resolve())
    need(known, "demos.recorded", cfg.demos.recorded, f"a csv in {cfg.paths.data}/, which DVC keeps track of")
    table = _read_csv(path, [*DEMO_KEY, *columns])
    groups = table.groupby(DEMO_KEY, sort=False, dropna=False).indices
    return {cast(Key, key): table[columns].to_numpy()[rows] for key, rows in groups.items()}


def _read_csv(path: Path, columns: list[str]) -> pd.DataFrame:
    """Return a user's csv; InputError if it is missing, unreadable, empty or lacks a column."""
    try:
        table = read_csv(path, ["user"])
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({error}): expected a csv; see CONTRIBUTING.md") from error
    if missing := [c for c in columns if c not in table.columns]:
        raise InputError(f"{path} has columns {list(table.columns)}: expected also {missing}; add them")
    if table.empty:
        raise InputError(f"{path} holds no sample: expected one a row; fill it, or set demos.recorded=null")
    return table


def _label(cfg: DictConfig, layouts: dict[str, Layouts], recorded: Recorded) -> Array:
    """Return whether each recorded trajectory keeps the user's margins (trajectory,)."""
    labels = np.zeros(len(recorded.keys), dtype=bool)
    for key, rows in recorded.keys.groupby(["seed", "user"]).indices.items():  # rows of a set are consecutive
        seed, user = cast(tuple[int, str], key)
        first, last = recorded.offsets[rows[0]], recorded.offsets[rows[-1] + 1]
        offsets = recorded.offsets[rows[0] : rows[-1] + 2] - first
        samples, scenes = recorded.samples[first:last], layouts[train_pool(seed)]
        labels[rows] = valid_trajectories(scenes, samples, offsets, cfg.users[user]).ravel()
    return labels


def _queries(cfg: DictConfig, pool: str, layouts: Layouts) -> Queries:
    """Draw random paths in a pool's scenes, clear of every user's boundary, and label them for every user."""
    training = [train_pool(seed) for seed in (*cfg.seeds, *cfg.validation_seeds)]
    count = cfg.demos.queries_seen if pool in training else cfg.demos.queries_new
    if cfg.demos.clear_m:
        z = _clear_paths(cfg, layouts, count, cfg.users, "queries", pool)
    else:
        z = random_z_theta(_generator(cfg, "queries", pool), len(layouts), count)
    return Queries(z, {user: valid(layouts, z, cfg.users[user]) for user in cfg.users})


def _generator(cfg: DictConfig, *names: str | int) -> np.random.Generator:
    """Return a random stream that depends only on these names."""
    return stream(cfg.demos.root_seed, "demos", *names)


if __name__ == "__main__":
    launch(main, "demos")
