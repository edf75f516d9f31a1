"""Stage repair: turn invalid paths into valid ones by gradient steps and by search, with baselines and the oracle."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.repairs import Starts, check_pool, draw_starts, paths_name, rows
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.artifacts.trained import check_weights, load_model
from pipeline.launch import launch
from pipeline.planning.measures import measures
from pipeline.planning.nearest import by_model, nearest
from pipeline.planning.oracle import constant_detour
from pipeline.planning.repair import Ascent, repair
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, Group, SharedSplit, Size, Whole, need, need_several_seeds, widest_margin
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta

SEARCHED = "clearance"  # the variant whose search results are reported as metrics


@dataclass(frozen=True)
class Job:
    """One model, and the invalid paths of its user."""

    cfg: DictConfig
    variant: str
    seed: int
    images: np.ndarray  # (scene, 100, 100, 3)
    candidates: np.ndarray  # (scene, start, 2) [m], including the valid ones
    starts: Starts


class Settings(Group):
    split: SharedSplit
    starts: Count
    steps: Count
    optimiser: Literal["gradient", "normalised", "adam"]
    rate: Size
    settle: bool
    distance_penalty: Size
    lattice_side: Count
    refinements: Whole


def agree(repair: Settings, parameters: Any) -> None:
    """Reject users whose paths are all valid."""
    need_several_seeds(parameters)
    users = parameters.users
    need(widest_margin(users) is not None, "users", users, "at least one user with a margin, or no path is invalid")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write repairs.parquet, paths.npz, summary.csv and metrics.json of every model at main_n_demos."""
    scenes = read_scenes(Path(cfg.paths.scenes))
    images = scenes.images[check_pool(cfg, scenes)]
    check_weights(cfg)
    candidates, starts = draw_starts(cfg, scenes)
    jobs = [
        Job(cfg, variant, seed, images, candidates, starts[user])
        for variant in cfg.variants
        for user in cfg.users
        for seed in cfg.protocol.seeds
    ]
    gradient, search, paths = zip(*map_jobs(run, jobs, cfg.workers, "repairs"), strict=True)
    tables = [*gradient, *search, *_baselines(cfg, scenes, starts)]
    table = pd.concat([t for t in tables if len(t)], ignore_index=True)
    summary = measures(table)
    write_table(out_dir / "repairs.parquet", table)
    names = [paths_name(job.variant, job.starts.user, job.seed) for job in jobs]
    write_arrays(out_dir / "paths.npz", dict(zip(names, paths, strict=True)))
    write_table(out_dir / "summary.csv", summary)
    write_json(out_dir / "metrics.json", _metrics(summary))


def run(job: Job) -> tuple[pd.DataFrame, pd.DataFrame, np.ndarray]:
    """Return a model's ends by gradient steps and by search, and its gradient steps (start, step + 1, 2) [m]."""
    r, s = job.cfg.repair, job.starts
    if len(s.z) == 0:
        return pd.DataFrame(), pd.DataFrame(), np.zeros((0, r.steps + 1, 2), np.float32)
    model = load_model(job.cfg, job.variant, s.user, job.seed, job.cfg.main_n_demos)
    ascent = Ascent(r.steps, r.optimiser, float(r.rate), bool(r.settle))
    repairs = repair(model, job.images, job.candidates, ascent)  # all candidates, so that batches have one shape
    z, p = repairs.z[s.scene, s.start], repairs.p[s.scene, s.start]
    log_valid = by_model(model, job.images)
    ends, log_p = nearest(log_valid, s.scene, s.z, float(r.distance_penalty), r.lattice_side, r.refinements)
    gradient = rows(s, "gradient", job.variant, job.seed, z[:, -1], p[:, 0], p[:, -1])
    return gradient, rows(s, "nearest", job.variant, job.seed, ends, p[:, 0], np.exp(log_p)), z


def _baselines(cfg: DictConfig, scenes: SceneSet, starts: dict[str, Starts]) -> list[pd.DataFrame]:
    """Return the ends of three references: a random path, the constant detour and the oracle.

    The detour is the path that is truly valid in most of a seed's training scenes. It ignores the image but knows the
    truth of every path there, not only n labels, which makes it a strong baseline.
    """
    tables = []
    for seed in cfg.protocol.seeds:
        training = scenes.layouts[train_pool(seed)]
        for user, s in starts.items():
            if len(s.z) == 0:
                continue
            rng = stream(cfg.scenes.root_seed, "repair", "random", seed, user)
            detour = constant_detour(training, s.margins, cfg.repair.lattice_side)
            ends = {
                "random_path": random_z_theta(rng, len(s.z)),
                "constant_detour": np.broadcast_to(detour, s.z.shape),
                "oracle": s.nearest,
            }
            tables += [rows(s, method, "", seed, z) for method, z in ends.items()]
    return tables


def _metrics(summary: pd.DataFrame) -> dict:
    """Return the success of gradient repair and the constant detour, and SEARCHED's search measures, by user."""
    by_method = {str(method): part.set_index("user") for method, part in summary.groupby("method")}
    gradient, detour, search = (by_method[name] for name in ("gradient", "constant_detour", "nearest"))
    success = {str(variant): part["success"].to_dict() for variant, part in gradient.groupby("variant", sort=False)}
    search = search.loc[search["variant"] == SEARCHED, ["success", "displacement_ratio", "unsafe"]]
    return {
        "repair": success | {"constant_detour": detour["success"].to_dict()},
        "search": {SEARCHED: search.to_dict("index")},
    }


if __name__ == "__main__":
    launch(main, "repair")
