"""Read and write repairs: the starts shared by all methods, and one table row per repaired path."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.planning.oracle import nearest_valid
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, clearance, slack, valid

READ_COLUMNS = ["method", "variant", "user", "seed", "scene", "start", "valid_end"]


@dataclass(frozen=True)
class Starts:
    """One user's invalid paths in the pool, the same for all seeds and variants."""

    user: str
    margins: Margins
    layouts: Layouts
    scene: Int[Array, " start"]
    start: Int[Array, " start"]  # number of the start within its scene
    z: Float[Array, "start 2"]  # z_theta [m]
    nearest: Float[Array, "start 2"]  # the nearest truly valid z_theta [m]


def check_pool(cfg: DictConfig, scenes: SceneSet) -> str:
    """Return the pool whose paths are repaired; InputError if stage scenes has not written it."""
    pool = cfg.protocol.splits[cfg.repair.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    return pool


def draw_starts(cfg: DictConfig, scenes: SceneSet) -> tuple[Float[Array, "scene start 2"], dict[str, Starts]]:
    """Draw random z_theta [m] in the pool's scenes; return all of them, and those invalid to each user.

    InputError if all are valid to every user.
    """
    pool = check_pool(cfg, scenes)
    layouts = scenes.layouts[pool]
    candidates = random_z_theta(stream(cfg.scenes.root_seed, "repair", "starts"), len(layouts), cfg.repair.starts)
    starts = {}
    for user, margins in cfg.users.items():
        scene, start = np.nonzero(~valid(layouts, candidates, margins))
        nearest = nearest_valid(layouts, candidates, margins, cfg.repair.lattice_side, cfg.repair.refinements)
        z, nearest = candidates[scene, start], nearest[scene, start]
        starts[str(user)] = Starts(str(user), margins, layouts, scene, start, z, nearest)
    if not any(len(s.z) for s in starts.values()):
        raise InputError(f"no user has an invalid path among those drawn in {pool}: raise repair.starts")
    return candidates, starts


def rows(
    starts: Starts,
    method: str,
    variant: str,
    seed: int,
    ends: Float[Array, "start 2"],
    p_start: Float[Array, " start"] | None = None,
    p_end: Float[Array, " start"] | None = None,
) -> pd.DataFrame:
    """Return one row per start: end point [m], the model's P(valid) at both (if there is a model), and the truth."""
    ends = ends.astype(np.float64)
    layouts = starts.layouts[starts.scene]  # one layout per row
    clearances = slack(layouts, clearance(layouts, ends[:, None]), starts.margins)[:, 0]
    return pd.DataFrame(
        {
            "method": method,
            "variant": variant,
            "user": starts.user,
            "seed": seed,
            "scene": starts.scene,
            "start": starts.start,
            "z0_x": starts.z[:, 0],
            "z0_y": starts.z[:, 1],
            "z_x": ends[:, 0],
            "z_y": ends[:, 1],
            "p_start": np.nan if p_start is None else p_start,
            "p_end": np.nan if p_end is None else p_end,
            "valid_end": clearances > 0,
            "accepted": pd.array([None] * len(ends) if p_end is None else p_end > DECISION, dtype="boolean"),
            "displacement_m": np.linalg.norm(ends - starts.z, axis=-1),
            "oracle_displacement_m": np.linalg.norm(starts.nearest - starts.z, axis=-1),
            "clearance_m": clearances,  # slack: clearance minus the user's margin, smallest over items
        }
    )


def paths_name(variant: str, user: str, seed: int) -> str:
    """Return the key of a model in paths.npz."""
    return f"{variant}-{user}-s{seed}"


def read_repairs(cfg: DictConfig) -> tuple[pd.DataFrame, dict[str, Float[Array, "start step 2"]]]:
    """Return the gradient repairs (columns READ_COLUMNS), and each model's paths [m] by `paths_name`.

    InputError if they do not agree.
    """
    directory = Path(cfg.paths.repair)
    table = read_table(directory / "repairs.parquet", READ_COLUMNS).query("method == 'gradient'")
    paths = read_arrays(directory / "paths.npz")
    counts = table.groupby(["variant", "user", "seed"]).size().to_dict()
    for key in product(cfg.variants, cfg.users, cfg.protocol.seeds):
        name, expected, count = paths_name(*key), counts.get(key, 0), len(paths.get(paths_name(*key), ()))
        if count != expected:
            raise InputError(f"{directory}: {expected} repairs of {name}, {count} paths; run the repair stage again")
    return table, paths
