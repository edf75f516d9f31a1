"""Read and write demonstrations and queries."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artifacts.files import read_arrays, read_table, write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, read_scenes
from pipeline.runtime.errors import InputError

DEMO_KEY = ["seed", "user", "scene", "demo"]
DEMO_COLUMNS = [*DEMO_KEY, "z_x", "z_y", "valid", "residual_m", "poor_fit", "duration_s", "samples"]


@dataclass(frozen=True)
class Queries:
    """Labelled test paths in a pool of scenes: z (scene, query, 2) [m], valid: user -> (scene, query) bool."""

    z: np.ndarray
    valid: dict[str, np.ndarray]


@lru_cache(maxsize=1)
def read_labelled(scenes_dir: str, demos_dir: str) -> tuple[SceneSet, pd.DataFrame, dict[str, Queries]]:
    """Read scenes, demonstrations and queries, once per process."""
    return read_scenes(Path(scenes_dir)), read_demos(Path(demos_dir)), read_queries(Path(demos_dir))


def write_demos(out_dir: Path, demos: pd.DataFrame, samples: np.ndarray, offsets: np.ndarray) -> None:
    """Write demos.parquet and, in the same row order, trajectories.npz (samples (total, 4): t [s], x, y, z [m])."""
    write_table(out_dir / "demos.parquet", demos[DEMO_COLUMNS])
    arrays = {"samples": samples.astype(np.float32), "offsets": offsets.astype(np.int64)}
    write_arrays(out_dir / "trajectories.npz", arrays)


def read_demos(directory: Path) -> pd.DataFrame:
    """Return the demonstrations, one row each, sorted by seed, user, scene, demo."""
    demos = read_table(directory / "demos.parquet", DEMO_COLUMNS)
    if not np.isfinite(demos[["z_x", "z_y"]].to_numpy()).all():
        raise InputError(f"{directory}/demos.parquet: a z_theta is not finite; run the demos stage again")
    return demos


def read_trajectories(directory: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return samples (total, 4) and offsets (demonstration + 1), in the row order of `read_demos`."""
    arrays = read_arrays(directory / "trajectories.npz")
    return arrays["samples"], arrays["offsets"]


def demo_arrays(demos: pd.DataFrame, seed: int, user: str, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the first `n` demonstrations of each scene: z (scene, n, 2) [m], valid (scene, n)."""
    rows = demos[(demos["seed"] == seed) & (demos["user"] == user) & (demos["demo"] < n)].sort_values(["scene", "demo"])
    scenes = rows["scene"].nunique()
    if scenes == 0 or len(rows) != scenes * n:
        found = f"{len(rows)} demonstrations of user {user}, seed {seed}"
        raise InputError(f"{found}: expected {n} in each scene; run the demos stage again")
    z = rows[["z_x", "z_y"]].to_numpy().reshape(scenes, n, 2)
    return z, rows["valid"].to_numpy(dtype=bool).reshape(scenes, n)


def write_queries(out_dir: Path, queries: dict[str, Queries]) -> None:
    """Write queries.npz with the arrays `{pool}/z` and `{pool}/{user}`."""
    arrays = {}
    for pool, q in queries.items():
        arrays[f"{pool}/z"] = q.z.astype(np.float64)
        arrays |= {f"{pool}/{user}": valid for user, valid in q.valid.items()}
    write_arrays(out_dir / "queries.npz", arrays)


def asked(queries: dict[str, Queries], pool: str, user: str) -> tuple[np.ndarray, np.ndarray]:
    """Return a pool's test paths (scene, query, 2) [m] and a user's labels of them; InputError if there are none."""
    if pool not in queries or user not in queries[pool].valid:
        raise InputError(f"no queries of {user} in {pool}: run `dvc repro demos`")
    return queries[pool].z, queries[pool].valid[user]


def read_queries(directory: Path) -> dict[str, Queries]:
    """Return the queries by pool."""
    arrays = read_arrays(directory / "queries.npz")
    pools: dict[str, Queries] = {}
    for name in (name for name in arrays if name.endswith("/z")):
        pool = name.removesuffix("/z")
        valid = {k.removeprefix(f"{pool}/"): v for k, v in arrays.items() if k.startswith(f"{pool}/") and k != name}
        pools[pool] = Queries(arrays[name], valid)
    return pools
