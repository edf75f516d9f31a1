"""The paths that robots carry out: repairs of every model, and references beside them."""

from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table
from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.runtime.streams import stream
from pipeline.world.bezier import P_F, P_INIT, random_z_theta
from pipeline.world.rules import valid

KEY = ["pool", "scene", "z_x", "z_y"]  # what an execution depends on
GROUP = ["method", "variant", "user"]
COLUMNS = [*GROUP, "seed", *KEY[:2], "start", *KEY[2:], "accepted", "valid"]
REPAIRS = "gradient", "nearest"  # methods of stage repair that have a model
UNREPAIRED, STRAIGHT, ORACLE, DEMONSTRATIONS = "unrepaired", "straight", "oracle", "demonstrations"


def all_paths(cfg: DictConfig, scenes: SceneSet, demos: pd.DataFrame) -> pd.DataFrame:
    """Return a row a path with COLUMNS: repairs by gradient steps and search, the oracle, unrepaired random paths,
    the straight path, and demonstrations in their training scenes.

    accepted: by the model; true where there is none. valid: by the truth.
    """
    pool, first = cfg.protocol.splits[cfg.repair.split], cfg.protocol.seeds[0]
    repairs = read_table(Path(cfg.paths.repair) / "repairs.parquet").rename(columns={"valid_end": "valid"})
    repairs = repairs.assign(pool=pool, variant=repairs["variant"].fillna(""))
    repairs["accepted"] = repairs["accepted"].astype("boolean").fillna(True).astype(bool)
    oracle = (repairs["method"] == ORACLE) & (repairs["seed"] == first)  # the same for all seeds
    parts = [repairs[repairs["method"].isin(REPAIRS) | oracle]]
    shown = demos.assign(method=DEMONSTRATIONS, variant="", accepted=True, start=demos["demo"])
    parts.append(shown.assign(pool=[train_pool(seed) for seed in demos["seed"]]))
    layouts = scenes.layouts[pool]
    middle = np.broadcast_to((P_INIT + P_F) / 2, (len(layouts), 1, 2))
    for method, z in ((UNREPAIRED, random_starts(cfg, len(layouts))), (STRAIGHT, middle)):
        scene, start = (index.ravel() for index in np.indices(z.shape[:2]))
        for user, margins in cfg.users.items():
            row = {"method": method, "variant": "", "user": user, "seed": first, "pool": pool, "accepted": True}
            part = pd.DataFrame({"scene": scene, "start": start, "valid": valid(layouts, z, margins).ravel()})
            parts.append(part.assign(**row, z_x=z[..., 0].ravel(), z_y=z[..., 1].ravel()))
    return pd.concat([part[COLUMNS] for part in parts], ignore_index=True)


def random_starts(cfg: DictConfig, scenes: int) -> Float[Array, "scene start 2"]:
    """Return the random paths [m] of stage repair, those that need no repair included."""
    return random_z_theta(stream(cfg.scenes.root_seed, "repair", "starts"), scenes, cfg.repair.starts)
