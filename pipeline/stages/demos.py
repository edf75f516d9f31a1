"""Stage demos: record demonstrations of every user, fit Bezier paths to them, and draw the query paths."""

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

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
from pipeline.runtime.settings import Count, Demonstrations, Distance, Group, Length, Pair, Size, Spread, Whole, need
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta
from pipeline.world.bezier_fit import fit
from pipeline.world.hand import Hand, check, join, simulate, valid_trajectories
from pipeline.world.rules import valid

Key = tuple[int, str, int, int]  # seed, user, scene, demo


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
    recorded: str | None
    ends_within_m: Length
    poor_above_m: Length
    hand: HandSettings


def agree(demos: Settings, parameters: Any) -> None:
    """Require demonstrations enough for each number that is fitted, and a band of tremor."""
    most = max(parameters.n_demos)
    need(demos.per_scene >= most, "demos.per_scene", demos.per_scene, f"at least max(n_demos) = {most}")
    low, high = demos.hand.tremor_hz
    band = "a band above 0, the lower end first, below half of rate_hz"
    need(0 < low <= high < demos.hand.rate_hz / 2, "demos.hand.tremor_hz", demos.hand.tremor_hz, band)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write demos.parquet, trajectories.npz and queries.npz."""
    by_people = _read_trajectories(cfg)
    scenes = read_scenes(Path(cfg.paths.scenes))
    pools = {seed: train_pool(seed) for seed in sorted([*cfg.seeds, *cfg.validation_seeds])}
    scenes.check_has(*pools.values())
    layouts = scenes.layouts
    keys = [
        (seed, user, scene, demo)
        for seed, pool in pools.items()
        for user in sorted(cfg.users)
        for scene in range(len(layouts[pool]))
        for demo in range(cfg.demos.per_scene)
    ]
    samples, offsets = join(_trajectories(cfg, keys, by_people))
    fits = fit(samples[:, 1:3], offsets, cfg.demos.poor_above_m)
    demos = pd.DataFrame(keys, columns=DEMO_KEY).assign(
        z_x=fits.z_theta[:, 0],
        z_y=fits.z_theta[:, 1],
        valid=False,
        residual_m=fits.residual_m,
        poor_fit=fits.poor,
        duration_s=samples[offsets[1:] - 1, 0] - samples[offsets[:-1], 0],
        samples=np.diff(offsets),
    )
    for (seed, user), rows in demos.groupby(["seed", "user"]):  # consecutive rows
        first, end = rows.index[0], rows.index[-1] + 1
        labels = valid_trajectories(
            layouts[pools[seed]],
            samples[offsets[first] : offsets[end]],
            offsets[first : end + 1] - offsets[first],
            cfg.users[user],
        )
        demos.loc[rows.index, "valid"] = labels.ravel()
    queries = {}
    for pool in sorted(layouts):
        count = cfg.demos.queries_seen if pool in pools.values() else cfg.demos.queries_new
        z = random_z_theta(stream(cfg.demos.root_seed, "demos", "queries", pool), len(layouts[pool]), count)
        queries[pool] = Queries(z, {user: valid(layouts[pool], z, margins) for user, margins in cfg.users.items()})
    write_demos(out_dir, demos, samples, offsets)
    write_queries(out_dir, queries)


def _trajectories(cfg: DictConfig, keys: Collection[Key], by_people: Mapping[Key, Array]) -> list[Array]:
    """Return each demonstration's trajectory (sample, 4), a person's or simulated, after checking it.

    Times begin at 0; all numbers are rounded to the stored float32. InputError if one of `by_people` has no key.
    """
    if unknown := sorted(set(by_people) - set(keys), key=str):
        raise InputError(
            f"{cfg.demos.recorded}: trajectory (seed, user, scene, demo) = {unknown[0]} belongs to no demonstration; "
            "expected seeds, users, scenes and demos of conf/; correct or remove it"
        )
    if by_people:
        print(f"{len(by_people)} of {len(keys)} demonstrations are a person's, from {cfg.demos.recorded}", flush=True)
    hand, trajectories = Hand.of(cfg.demos.hand), []
    for key in tqdm(keys, desc="demos"):
        if (trajectory := by_people.get(key)) is None:
            rng = stream(cfg.demos.root_seed, "demos", "recording", *key)
            trajectory = simulate(rng, random_z_theta(rng), hand)
        check(trajectory, "seed {} user {} scene {} demo {}".format(*key), cfg.demos.ends_within_m)
        since_start = trajectory - [trajectory[0, 0], 0.0, 0.0, 0.0]  # float32 cannot represent absolute clock times
        trajectories.append(since_start.astype(np.float32).astype(float))
    return trajectories


def _read_trajectories(cfg: DictConfig) -> dict[Key, Array]:
    """Return the trajectories of the csv `demos.recorded` by key, unchecked; none without a csv."""
    if cfg.demos.recorded is None:
        return {}
    path, columns = Path(cfg.demos.recorded), ["t", "x", "y", "z"]
    known = path.resolve().is_relative_to(Path(cfg.paths.data).resolve())
    need(known, "demos.recorded", cfg.demos.recorded, f"a csv in {cfg.paths.data}/, which DVC keeps track of")
    try:
        table = read_csv(path, ["user"])
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read ({error}): expected a csv; see CONTRIBUTING.md") from error
    if missing := [c for c in (*DEMO_KEY, *columns) if c not in table.columns]:
        raise InputError(f"{path} has columns {list(table.columns)}: expected also {missing}; add them")
    if table.empty:
        raise InputError(f"{path} holds no sample: expected one a row; fill it, or set demos.recorded=null")
    groups = table.groupby(DEMO_KEY, sort=False, dropna=False).indices
    return {key: table[columns].to_numpy()[rows] for key, rows in groups.items()}  # pyright: ignore[reportReturnType]


if __name__ == "__main__":
    launch(main, "demos")
