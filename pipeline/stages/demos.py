"""Stage demos: records demonstrations of every user, fits them by Bezier paths, draws the paths to be judged."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import pandas as pd
from numpy import ndarray as Array
from omegaconf import DictConfig
from tqdm import tqdm

from pipeline.artifacts.demos import DEMO_KEY, Queries, write_demos, write_queries
from pipeline.artifacts.files import write_json
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.launch import launch
from pipeline.params import need
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta
from pipeline.world.bezier_fit import fit
from pipeline.world.hand import Hand, check, join, keeps, simulate
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, valid

Key = tuple[int, str, int, int]  # seed, user, scene, demo


@dataclass(frozen=True)
class Recorded:
    """Recordings one after the other, in the order of their keys, and where each begins."""

    keys: pd.DataFrame
    samples: Array  # (total, 4) t [s], x, y, z [m], rounded to the float32 that is stored
    offsets: Array  # (recording + 1,)
    real: int  # how many are a person's; the others are simulated


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write demos.parquet, trajectories.npz, queries.npz and metrics.json."""
    layouts = read_scenes(Path(cfg.paths.scenes)).layouts
    recorded = _record(cfg, layouts)
    fits = fit(recorded.samples[:, 1:3], recorded.offsets, cfg.demos.poor_above_m)
    demos = recorded.keys.assign(
        z_x=fits.z_theta[:, 0],
        z_y=fits.z_theta[:, 1],
        valid=_judge(cfg, layouts, recorded),
        residual_m=fits.residual_m,
        poor_fit=fits.poor,
        duration_s=recorded.samples[recorded.offsets[1:] - 1, 0] - recorded.samples[recorded.offsets[:-1], 0],
        samples=np.diff(recorded.offsets),
    )
    queries = {pool: _queries(cfg, pool, layouts[pool]) for pool in sorted(layouts)}
    shared = [pool for pool in queries if pool not in _training_pools(cfg)]
    metrics = {"recorded": recorded.real} | _metrics(
        demos, _judge_fits(cfg, layouts, demos), {pool: queries[pool] for pool in shared}
    )
    write_demos(out_dir, demos, recorded.samples, recorded.offsets)
    write_queries(out_dir, queries)
    write_json(out_dir / "metrics.json", metrics)


def _record(cfg: DictConfig, layouts: dict[str, Layouts]) -> Recorded:
    """Simulated recordings, or the real ones of `demos.recorded` where it has them; each is checked."""
    hand = Hand.of(cfg.demos.hand)
    keys = [
        (seed, user, scene, demo)
        for seed in sorted([*cfg.seeds, *cfg.validation_seeds])
        for user in sorted(cfg.users)
        for scene in range(len(_training(layouts, seed)))
        for demo in range(cfg.demos.per_scene)
    ]
    real = _real(cfg, set(keys))
    recordings = []
    for key in tqdm(keys, desc="demos"):
        recording = real.get(key)
        if recording is None:
            rng = _generator(cfg, "recording", *key)
            recording = simulate(rng, random_z_theta(rng), hand)
        check(recording, "seed {} user {} scene {} demo {}".format(*key), cfg.demos.ends_within_m)
        since_start = recording - [recording[0, 0], 0.0, 0.0, 0.0]  # a clock's own count has no room in float32
        recordings.append(since_start.astype(np.float32).astype(float))
    return Recorded(pd.DataFrame(keys, columns=DEMO_KEY), *join(recordings), len(real))


def _real(cfg: DictConfig, keys: set[Key]) -> dict[Key, Array]:
    """Recordings of a csv by their keys, unchecked; InputError for one that no demonstration asks for."""
    if cfg.demos.recorded is None:
        return {}
    path, columns = Path(cfg.demos.recorded), ["t", "x", "y", "z"]
    known = path.resolve().is_relative_to(Path(cfg.paths.data).resolve())
    need(cfg, "demos.recorded", known, f"a csv in {cfg.paths.data}/, which DVC keeps track of")
    table = _read_recordings(path, [*DEMO_KEY, *columns])
    real: dict[Key, Array] = {}
    for key, rows in table.groupby(DEMO_KEY, sort=False, dropna=False).indices.items():
        if key not in keys:
            raise InputError(
                f"{path}: recording (seed, user, scene, demo) = {key} belongs to no demonstration; expected seeds, "
                "users, scenes and demos of conf/; correct or remove it"
            )
        real[key] = table[columns].to_numpy()[rows]
    return real


def _read_recordings(path: Path, columns: list[str]) -> pd.DataFrame:
    """A person's own csv; InputError if it is missing, no csv, without a column, or empty."""
    try:
        table = pd.read_csv(path)
    except (OSError, ValueError) as error:
        raise InputError(f"recordings {path} cannot be read ({error}): expected a csv; see CONTRIBUTING.md") from error
    if missing := [c for c in columns if c not in table.columns]:
        raise InputError(f"recordings {path} have columns {list(table.columns)}: expected also {missing}; add them")
    if table.empty:
        raise InputError(f"recordings {path} hold no sample: expected one a row; fill it, or set demos.recorded=null")
    return table


def _judge(cfg: DictConfig, layouts: dict[str, Layouts], recorded: Recorded) -> Array:
    """Whether each recorded line keeps the user's margins (recording,)."""
    out = np.zeros(len(recorded.keys), dtype=bool)
    for (seed, user), rows, _ in _sets(recorded.keys, layouts):
        first, last = recorded.offsets[rows[0]], recorded.offsets[rows[-1] + 1]
        offsets = recorded.offsets[rows[0] : rows[-1] + 2] - first
        kept = keeps(layouts[train_pool(seed)], recorded.samples[first:last], offsets, _margins(cfg, user))
        out[rows] = kept.ravel()
    return out


def _judge_fits(cfg: DictConfig, layouts: dict[str, Layouts], demos: pd.DataFrame) -> Array:
    """Whether each fitted path keeps the user's margins (recording,)."""
    out = np.zeros(len(demos), dtype=bool)
    for (seed, user), rows, shape in _sets(demos, layouts):
        z = demos[["z_x", "z_y"]].to_numpy()[rows].reshape(*shape, 2)
        out[rows] = valid(layouts[train_pool(seed)], z, _margins(cfg, user)).ravel()
    return out


def _sets(keys: pd.DataFrame, layouts: dict[str, Layouts]) -> Iterator[tuple[tuple[int, str], Array, tuple[int, int]]]:
    """Each training set: (seed, user), its consecutive rows, and their shape (scene, demo)."""
    for key, rows in keys.groupby(["seed", "user"]).indices.items():
        seed, user = cast(tuple[int, str], key)
        scenes = len(layouts[train_pool(seed)])
        yield (seed, user), rows, (scenes, len(rows) // scenes)


def _queries(cfg: DictConfig, pool: str, layouts: Layouts) -> Queries:
    """Random paths through a pool's scenes, and their truth for every user."""
    count = cfg.demos.queries_seen if pool in _training_pools(cfg) else cfg.demos.queries_new
    z = random_z_theta(_generator(cfg, "queries", pool), len(layouts), count)
    return Queries(z, {user: valid(layouts, z, _margins(cfg, user)) for user in cfg.users})


def _metrics(demos: pd.DataFrame, fitted_valid: Array, queries: dict[str, Queries]) -> dict:
    """What `dvc metrics show` prints of the demonstrations."""
    kept, poor = demos["valid"].to_numpy(), demos["poor_fit"].to_numpy()
    residual = np.quantile(demos["residual_m"].to_numpy(), [0.25, 0.5, 0.75, 1.0])
    users = {user: (demos["user"] == user).to_numpy() for user in sorted(set(demos["user"]))}
    return {
        "demonstrations": len(demos),
        "samples": int(demos["samples"].to_numpy().sum()),
        "duration_s": float(demos["duration_s"].to_numpy().mean()),
        "residual_m": dict(zip(("q1", "median", "q3", "max"), residual.tolist(), strict=True)),
        "poor_fits": {user: int(poor[rows].sum()) for user, rows in users.items()},
        "valid": {user: float(kept[rows].mean()) for user, rows in users.items()},
        "label_agreement": {user: float((kept == fitted_valid)[rows].mean()) for user, rows in users.items()},
        "queries": {
            pool: {user: float(v.mean()) for user, v in q.valid.items()} | {"count": int(q.z[..., 0].size)}
            for pool, q in queries.items()
        },
    }


def _training_pools(cfg: DictConfig) -> list[str]:
    return [train_pool(seed) for seed in (*cfg.seeds, *cfg.validation_seeds)]


def _training(layouts: dict[str, Layouts], seed: int) -> Layouts:
    """A seed's own scenes; InputError if the scenes stage has not drawn them."""
    if train_pool(seed) not in layouts:
        raise InputError(f"no scenes {train_pool(seed)} among {sorted(layouts)}: run the scenes stage with seed {seed}")
    return layouts[train_pool(seed)]


def _margins(cfg: DictConfig, user: str) -> Margins:
    return dict(cfg.users[user])


def _generator(cfg: DictConfig, *names: str | int) -> np.random.Generator:
    """A stream of its own for whatever `names` name, however many others there are."""
    return stream(cfg.demos.root_seed, "demos", *names)


if __name__ == "__main__":
    launch(main, "demos")
