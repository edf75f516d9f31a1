"""Stage repair: gradient steps from invalid paths among unseen items, beside nulls and oracle, by the truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.repairs import Starts, check_pool, draw_starts, rows
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.artifacts.trained import check_weights, load_model
from pipeline.launch import launch
from pipeline.planning.measures import MEASURES, measures, summary
from pipeline.planning.oracle import constant_detour
from pipeline.planning.repair import Ascent, Repairs, repair
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta

REFERENCES = ("random_path", "constant_detour_baseline", "oracle")
Tables = dict[tuple[str, str, int], pd.DataFrame]  # (method, user, seed) -> a row per start


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
    """repairs.parquet, paths.npz and metrics.json of all variants, users and seeds at main_n_demos."""
    ascent = _ascent(cfg)
    scenes = read_scenes(Path(cfg.paths.scenes))
    pool = check_pool(cfg, scenes)
    candidates, starts = draw_starts(cfg, scenes)
    jobs = [
        Job(cfg, variant, user, seed, scenes.images[pool], candidates)
        for variant in cfg.variants
        for user in cfg.users
        for seed in cfg.protocol.seeds
    ]
    check_weights(cfg)
    needed = [job for job in jobs if len(starts[job.user].z)]
    done = dict(zip(map(_name, needed), map_jobs(run, needed, cfg.workers, "repairs"), strict=True))

    tables, paths = {}, {}
    for job in jobs:
        s = starts[job.user]
        z, p = (done[_name(job)].z[s.at], done[_name(job)].p[s.at]) if len(s.z) else _nothing(ascent)
        paths[_name(job)] = z
        tables[job.variant, job.user, job.seed] = rows(s, job.variant, job.seed, z[:, -1], p)
    tables |= _references(cfg, scenes, starts)
    table = pd.concat([t for t in tables.values() if len(t)], ignore_index=True)
    metrics = _metrics(cfg, tables, starts)
    write_table(out_dir / "repairs.parquet", table)
    write_arrays(out_dir / "paths.npz", paths)
    write_json(out_dir / "metrics.json", metrics)


def run(job: Job) -> Repairs:
    """One model's ascents; every candidate is repaired, so that batches have one shape."""
    model = load_model(job.cfg, job.variant, job.user, job.seed, job.cfg.main_n_demos)
    return repair(model, job.images, job.candidates, _ascent(job.cfg))


def _name(job: Job) -> str:
    """A job's key in paths.npz."""
    return f"{job.variant}-{job.user}-s{job.seed}"


def _ascent(cfg: DictConfig) -> Ascent:
    """How models climb, from conf/repair."""
    r = cfg.repair
    return Ascent(r.steps, r.optimiser, float(r.rate), bool(r.settle))


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
            rng = stream(cfg.scenes.root_seed, "repair", "random", seed, user)
            ends = (random_z_theta(rng, len(s.z)), np.broadcast_to(detour, s.z.shape), s.nearest)
            for method, z in zip(REFERENCES, ends, strict=True):
                tables[method, user, seed] = rows(s, method, seed, z, None)
    return tables


def _metrics(cfg: DictConfig, tables: Tables, starts: dict[str, Starts]) -> dict:
    """variant -> user -> `summary` over seeds, and the references' means beside it.

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
            by_seed = pd.DataFrame([measures(tables[name, user, seed]) for seed in seeds])
            beside[name] = float(np.mean(by_seed["success"]))
            beside[f"{name}_displacement_ratio"] = float(np.mean(by_seed["displacement_ratio"]))
        for variant in cfg.variants:
            out[variant][user] = summary([tables[variant, user, seed] for seed in seeds]) | beside
    return out


if __name__ == "__main__":
    launch(main, "repair")
