"""Stage repair: gradient steps from invalid paths among unseen items, beside nulls and oracle, by the truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.models import model_dir, weights_path
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.artifacts.trained import load_model
from pipeline.causal.statistics import quartiles
from pipeline.launch import launch
from pipeline.parallel import map_jobs
from pipeline.params import InputError
from pipeline.spec.metrics import DECISION
from pipeline.spec.repair import Ascent, Repairs, repair
from pipeline.spec.training import job_seed
from pipeline.table.bezier import random_z_theta
from pipeline.table.layout import Layouts
from pipeline.table.oracle import constant_detour, nearest_valid
from pipeline.table.rules import Margins, clearance, slack, valid

REFERENCES = ("null_random", "null_constant", "oracle")
MEASURES = (
    "success", "correct", "fooled", "abstained", "displacement_m", "displacement_ratio", "oracle_displacement_m",
)  # fmt: skip
Tables = dict[tuple[str, str, int], pd.DataFrame]  # (method, user, seed) -> a row per start
COLUMNS = [
    "method", "seed", "user", "scene", "start", "z0_x", "z0_y", "z_x", "z_y", "p_start", "p_end", "valid_end",
    "accepted", "displacement_m", "oracle_displacement_m", "clearance_m",
]  # fmt: skip


@dataclass(frozen=True)
class Starts:
    """One user's invalid paths in the pool, the same for all seeds and variants, and the nearest valid ones."""

    user: str
    margins: Margins
    layouts: Layouts
    at: tuple[np.ndarray, np.ndarray]  # scene and start of each
    z: np.ndarray  # (start, 2) [m]
    nearest: np.ndarray  # (start, 2) [m]: the oracle's


@dataclass(frozen=True)
class Job:
    """One model's repairs of every candidate of its user."""

    cfg: DictConfig
    variant: str
    user: str
    seed: int
    images: np.ndarray
    candidates: np.ndarray  # (scene, start, 2) [m]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """repairs.parquet, paths.npz and metrics.json of all variants, users and seeds at study_n."""
    ascent = _ascent(cfg)
    scenes = read_scenes(Path(cfg.paths.scenes))
    pool = _pool(cfg, scenes)
    layouts = scenes.layouts[pool]
    rng = np.random.default_rng(job_seed(cfg.scenes.generator, "repair", "starts"))
    candidates = random_z_theta(rng, len(layouts), cfg.repair.starts)
    starts = {user: _starts(cfg, user, layouts, candidates) for user in cfg.users}
    jobs = [
        Job(cfg, variant, user, seed, scenes.images[pool], candidates)
        for variant in cfg.variants
        for user in cfg.users
        for seed in cfg.protocol.seeds
    ]
    _check_weights(cfg, jobs)
    needed = [job for job in jobs if len(starts[job.user].z)]
    if not needed:
        raise InputError(f"no user has an invalid path among those drawn in {pool}: raise repair.starts")
    done = dict(zip(map(_name, needed), map_jobs(run, needed, cfg.workers, "repairs"), strict=True))

    tables, paths = {}, {}
    for job in jobs:
        s = starts[job.user]
        z, p = (done[_name(job)].z[s.at], done[_name(job)].p[s.at]) if len(s.z) else _nothing(ascent)
        paths[_name(job)] = z
        tables[job.variant, job.user, job.seed] = _rows(s, job.variant, job.seed, z[:, -1], p)
    tables |= _references(cfg, scenes, starts)
    table = pd.concat([t for t in tables.values() if len(t)], ignore_index=True)
    metrics = _metrics(cfg, tables, starts)
    write_table(out_dir / "repairs.parquet", table)
    write_arrays(out_dir / "paths.npz", paths)
    write_json(out_dir / "metrics.json", metrics)


def run(job: Job) -> Repairs:
    """One model's ascents; every candidate is repaired, so that batches have one shape."""
    model = load_model(job.cfg, job.variant, job.user, job.seed, job.cfg.study_n)
    return repair(model, job.images, job.candidates, _ascent(job.cfg))


def _name(job: Job) -> str:
    """A job's key in paths.npz."""
    return f"{job.variant}-{job.user}-s{job.seed}"


def _ascent(cfg: DictConfig) -> Ascent:
    """How models climb, from conf/repair."""
    r = cfg.repair
    if not (isinstance(r.steps, int) and r.steps >= 1):
        raise InputError(f"repair.steps is {r.steps!r}: expected a whole number from 1")
    return Ascent(r.steps, r.optimiser, float(r.rate), bool(r.settle))


def _pool(cfg: DictConfig, scenes: SceneSet) -> str:
    """The pool to repair in; InputError if conf/repair or the scenes stage does not provide it."""
    for name in ("starts", "lattice_side"):
        if not (isinstance(cfg.repair[name], int) and cfg.repair[name] >= 1):
            raise InputError(f"repair.{name} is {cfg.repair[name]!r}: expected a whole number from 1")
    pool = cfg.protocol.splits.get(cfg.repair.split)
    if pool is None:
        shared = [split for split, p in cfg.protocol.splits.items() if p is not None]
        raise InputError(f"repair.split is {cfg.repair.split!r}: expected one of {', '.join(shared)}")
    for name in (pool, *(train_pool(seed) for seed in cfg.protocol.seeds)):
        if name not in scenes.layouts:
            raise InputError(f"no scenes {name}: there are {', '.join(scenes.layouts)}; run the scenes stage")
    return pool


def _check_weights(cfg: DictConfig, jobs: list[Job]) -> None:
    """Raise InputError for the first model that is missing, before any is repaired with."""
    for job in jobs:
        path = weights_path(model_dir(cfg, job.variant), job.user, job.seed, cfg.study_n)
        if not path.is_file():
            stage = cfg.variants[job.variant].stage
            raise InputError(f"{path} is missing: run stage {stage} for variant {job.variant} first")


def _starts(cfg: DictConfig, user: str, layouts: Layouts, candidates: np.ndarray) -> Starts:
    """The candidates that are invalid to a user, and the oracle's answer to each."""
    margins = cfg.users[user]
    scene, start = np.nonzero(~valid(layouts, candidates, margins))
    nearest = nearest_valid(layouts, candidates, margins, cfg.repair.lattice_side, cfg.repair.refinements)
    return Starts(user, margins, layouts, (scene, start), candidates[scene, start], nearest[scene, start])


def _nothing(ascent: Ascent) -> tuple[np.ndarray, np.ndarray]:
    """The repairs of no start."""
    return np.zeros((0, ascent.steps + 1, 2), np.float32), np.zeros((0, ascent.steps + 1), np.float32)


def _references(cfg: DictConfig, scenes: SceneSet, starts: dict[str, Starts]) -> Tables:
    """What repairs are held against: a random z, a constant detour, and the nearest valid path.

    The detour is the one truly valid in most of a seed's own training scenes: it ignores the image, but it
    is given the truth of every path there, not n labels, which makes it a strong null.
    """
    tables = {}
    for seed in cfg.protocol.seeds:
        training = scenes.layouts[train_pool(seed)]
        for user, s in starts.items():
            detour = constant_detour(training, s.margins, cfg.repair.lattice_side)
            rng = np.random.default_rng(job_seed(cfg.scenes.generator, "repair", "random", seed, user))
            ends = (random_z_theta(rng, len(s.z)), np.broadcast_to(detour, s.z.shape), s.nearest)
            for method, z in zip(REFERENCES, ends, strict=True):
                tables[method, user, seed] = _rows(s, method, seed, z, None)
    return tables


def _rows(starts: Starts, method: str, seed: int, z: np.ndarray, p: np.ndarray | None) -> pd.DataFrame:
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


def _metrics(cfg: DictConfig, tables: Tables, starts: dict[str, Starts]) -> dict:
    """variant -> user -> means over seeds, quartiles (`_q1`, `_q3`), and the references' means beside them.

    Every rate and length is null for a user without an invalid start (vacuous).
    """
    seeds = list(cfg.protocol.seeds)
    out: dict = {variant: {} for variant in cfg.variants}
    for user, s in starts.items():
        if len(s.z) == 0:
            nothing = dict.fromkeys([*MEASURES, *REFERENCES])
            for variant in cfg.variants:
                out[variant][user] = nothing | {"seeds": len(seeds), "starts": 0, "vacuous": True}
            continue
        beside = {"seeds": len(seeds), "starts": len(s.z), "vacuous": False}
        for name in REFERENCES:
            by_seed = pd.DataFrame([_measures(tables[name, user, seed]) for seed in seeds])
            beside[name] = float(np.mean(by_seed["success"]))
            beside[f"{name}_displacement_ratio"] = float(np.mean(by_seed["displacement_ratio"]))
        for variant in cfg.variants:
            by_seed = pd.DataFrame([_measures(tables[variant, user, seed]) for seed in seeds])
            cell: dict = {}
            for name in MEASURES:
                spread = quartiles(by_seed[name].to_numpy())
                cell |= {name: spread["mean"], f"{name}_q1": spread["q1"], f"{name}_q3": spread["q3"]}
            out[variant][user] = cell | beside
    return out


def _measures(rows: pd.DataFrame) -> dict[str, float]:
    """MEASURES of one method, user and seed.

    success: the share of ends that are truly valid, accepted or not. An end is accepted (p > .5) and correct,
    accepted and fooled, or abstained from: the three sum to 1 (a reference accepts nothing itself: NaN).
    displacement_ratio: the mean displacement over the oracle's mean, both over all starts, so that no start
    close to the boundary blows it up.
    """
    right = rows["valid_end"].to_numpy(dtype=float)
    accepted = rows["accepted"].to_numpy(dtype=float, na_value=np.nan)
    moved, least = (rows[name].to_numpy().mean() for name in ("displacement_m", "oracle_displacement_m"))
    values = (right, accepted * right, accepted * (1 - right), 1 - accepted, moved, moved / least, least)
    return {name: float(np.mean(value)) for name, value in zip(MEASURES, values, strict=True)}


if __name__ == "__main__":
    launch(main, "repair")
