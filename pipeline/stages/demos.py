"""Stage demos: record demonstrations of every user, fit Bezier paths to them, and draw the query paths."""

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import DEMO_KEY, Queries, write_demos, write_queries
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.launch import launch
from pipeline.runtime.settings import Count, Demonstrations, Group, Length, Whole, need
from pipeline.runtime.streams import stream
from pipeline.world.bezier import curve, random_z_theta
from pipeline.world.bezier_fit import fit
from pipeline.world.hand import ARC_POINTS, Hand, join, simulate, valid_trajectories
from pipeline.world.rules import valid


class Settings(Group):
    root_seed: Whole
    per_scene: Demonstrations
    queries_seen: Count
    queries_new: Count
    poor_above_m: Length
    hand: Hand


def agree(demos: Settings, parameters: Any) -> None:
    """Require demonstrations enough for each number that is fitted, and a band of tremor."""
    most = max(parameters.n_demos)
    need(demos.per_scene >= most, "demos.per_scene", demos.per_scene, f"at least max(n_demos) = {most}")
    low, high = demos.hand.tremor_hz
    band = "a band above 0, the lower end first, below half of rate_hz"
    need(0 < low <= high < demos.hand.rate_hz / 2, "demos.hand.tremor_hz", demos.hand.tremor_hz, band)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write demos.parquet, trajectories.npz and queries.npz."""
    scenes = read_scenes(Path(cfg.paths.scenes))
    pools = {seed: train_pool(seed) for seed in sorted([*cfg.seeds, *cfg.validation_seeds])}
    scenes.check_has(*pools.values())
    layouts = scenes.layouts
    keys: list[tuple[int, str, int, int]] = []  # seed, user, scene, demo
    for seed, pool in pools.items():
        keys += product([seed], sorted(cfg.users), range(len(layouts[pool])), range(cfg.demos.per_scene))
    hand, trajectories = Hand.of(cfg.demos.hand), []
    for key in tqdm(keys, desc="demos"):
        rng = stream(cfg.demos.root_seed, "demos", "recording", *key)
        trajectory = simulate(rng, curve(random_z_theta(rng), ARC_POINTS), hand)
        trajectories.append(trajectory.astype(np.float32).astype(float))  # rounded to the stored numbers
    samples, offsets = join(trajectories)
    fits = fit(samples[:, 1:3], offsets, cfg.demos.poor_above_m)
    demos = pd.DataFrame(keys, columns=DEMO_KEY).assign(valid=False, residual_m=fits.residual_m, poor_fit=fits.poor)
    duration = samples[offsets[1:] - 1, 0] - samples[offsets[:-1], 0]
    demos = demos.assign(z_x=fits.z_theta[:, 0], z_y=fits.z_theta[:, 1], duration_s=duration, samples=np.diff(offsets))
    for (seed, user), rows in demos.groupby(["seed", "user"]):  # consecutive rows
        own = offsets[rows.index[0] : rows.index[-1] + 2]
        recorded = samples[own[0] : own[-1]], own - own[0]
        labels = valid_trajectories(layouts[pools[seed]], *recorded, cfg.users[user])
        demos.loc[rows.index, "valid"] = labels.ravel()
    queries = {}
    for pool in sorted(layouts):
        count = cfg.demos.queries_seen if pool in pools.values() else cfg.demos.queries_new
        z = random_z_theta(stream(cfg.demos.root_seed, "demos", "queries", pool), len(layouts[pool]), count)
        queries[pool] = Queries(z, {user: valid(layouts[pool], z, margins) for user, margins in cfg.users.items()})
    write_demos(out_dir, demos, samples, offsets)
    write_queries(out_dir, queries)


if __name__ == "__main__":
    launch(main, "demos")
