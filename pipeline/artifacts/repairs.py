"""Repairs, judged by the truth: the starts that stages repair and search share, and the table of where they end."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.planning.oracle import nearest_valid
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, clearance, slack, valid


@dataclass(frozen=True)
class Starts:
    """One user's invalid paths in the pool, the same for all seeds and variants, and the nearest valid ones."""

    user: str
    margins: Margins
    layouts: Layouts
    at: tuple[np.ndarray, np.ndarray]  # scene and start of each
    z: np.ndarray  # (start, 2) [m]
    nearest: np.ndarray  # (start, 2) [m]: the oracle's

    def first(self, count: int | None) -> "Starts":
        """The first of them; None: all."""
        few = slice(count)
        return replace(self, at=(self.at[0][few], self.at[1][few]), z=self.z[few], nearest=self.nearest[few])


def check_pool(cfg: DictConfig, scenes: SceneSet) -> str:
    """The pool to repair in; InputError if conf/repair or the scenes stage does not provide it."""
    pool = cfg.protocol.splits[cfg.repair.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    return pool


def draw_starts(cfg: DictConfig, scenes: SceneSet) -> tuple[np.ndarray, dict[str, Starts]]:
    """Random z_theta (scene, start, 2) [m] in the pool's scenes; of them each user's invalid ones, some at least."""
    pool = check_pool(cfg, scenes)
    layouts = scenes.layouts[pool]
    rng = stream(cfg.scenes.root_seed, "repair", "starts")
    candidates = random_z_theta(rng, len(layouts), cfg.repair.starts)
    starts = {user: _starts(cfg, user, layouts, candidates) for user in cfg.users}
    if not any(len(s.z) for s in starts.values()):
        raise InputError(f"no user has an invalid path among those drawn in {pool}: raise repair.starts")
    return candidates, starts


def _starts(cfg: DictConfig, user: str, layouts: Layouts, candidates: np.ndarray) -> Starts:
    """The candidates that are invalid to a user, and the oracle's answer to each."""
    margins = cfg.users[user]
    scene, start = np.nonzero(~valid(layouts, candidates, margins))
    nearest = nearest_valid(layouts, candidates, margins, cfg.repair.lattice_side, cfg.repair.refinements)
    return Starts(user, margins, layouts, (scene, start), candidates[scene, start], nearest[scene, start])


def rows(starts: Starts, method: str, seed: int, z: np.ndarray, p: np.ndarray | None) -> pd.DataFrame:
    """One row per start: where it ended, what the model made of it (`p`, None without one), what is true."""
    scene, start = starts.at
    z = z.astype(np.float64)
    layouts = starts.layouts[scene]  # each row in its own scene
    room = slack(layouts, clearance(layouts, z[:, None]), starts.margins)[:, 0]
    return pd.DataFrame(
        {
            "method": method,
            "seed": seed,
            "user": starts.user,
            "scene": scene,
            "start": start,
            "z0_x": starts.z[:, 0],
            "z0_y": starts.z[:, 1],
            "z_x": z[:, 0],
            "z_y": z[:, 1],
            "p_start": np.nan if p is None else p[:, 0],
            "p_end": np.nan if p is None else p[:, -1],
            "valid_end": room > 0,
            "accepted": pd.array([None] * len(z) if p is None else p[:, -1] > DECISION, dtype="boolean"),
            "displacement_m": np.linalg.norm(z - starts.z, axis=-1),
            "oracle_displacement_m": np.linalg.norm(starts.nearest - starts.z, axis=-1),
            "clearance_m": room,
        }
    )
