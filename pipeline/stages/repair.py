"""Stage repair: turn invalid paths into valid ones by gradient steps and by search, with baselines and the oracle."""

from collections.abc import Mapping
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.models import model_name
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models.trained import check_weights, load_model
from pipeline.planning.nearest import by_model, constant_detour, nearest
from pipeline.planning.repair import Ascent, repair
from pipeline.planning.results import Starts, measures, rows
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, SharedSplit, Size, Whole, need, widest_margin
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta

UNSEEN = "new_items"  # the split whose items are unseen, and so a source of chance
SEARCHED = "clearance"  # the variant whose search results are reported as metrics


class Settings(Ascent):
    split: SharedSplit
    starts: Count
    plain_rate: Size
    distance_penalty: Size
    lattice_side: Count
    refinements: Whole


def agree(repair: Settings, parameters: Any) -> None:
    """Reject users whose paths are all valid."""
    users = parameters.users
    need(widest_margin(users) is not None, "users", users, "at least one user with a margin, or no path is invalid")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write repairs.parquet, paths.npz, summary.csv and metrics.json of every model at main_n_demos."""
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.repair.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    check_weights(cfg)
    layouts, r = scenes.layouts[pool], cfg.repair
    candidates = random_z_theta(stream(cfg.scenes.root_seed, "repair", "starts"), len(layouts), r.starts)
    given = layouts, candidates, r.lattice_side, r.refinements
    starts = {user: Starts.of(user, margins, *given) for user, margins in cfg.users.items()}
    if not any(len(s.z) for s in starts.values()):
        raise InputError(f"no user has an invalid path among those drawn in {pool}: raise repair.starts")
    models = list(product(cfg.variants, cfg.users, cfg.protocol.seeds))
    jobs = [(variant, seed, starts[user]) for variant, user, seed in models]
    repairs = map_jobs(partial(_repair, cfg, scenes.images[pool], candidates), jobs, cfg.workers, "repairs")
    gradient, plain, search, paths = zip(*repairs, strict=True)
    tables = [*gradient, *plain, *search, *_baselines(cfg, scenes, starts)]
    table = pd.concat([t for t in tables if len(t)], ignore_index=True)
    which = np.unique(layouts.item[layouts.present])
    items = ((layouts.item[..., None] == which) * (1 + layouts.symbol[..., None])).max(1)
    summary = measures(table, items if r.split == UNSEEN else None)
    write_table(out_dir / "repairs.parquet", table)
    write_arrays(out_dir / "paths.npz", {model_name(*key): z for key, z in zip(models, paths, strict=True)})
    write_table(out_dir / "summary.csv", summary)
    write_json(out_dir / "metrics.json", _metrics(summary))


def _repair(cfg: DictConfig, images: Array, candidates: Array, job: tuple[str, int, Starts]) -> tuple:
    """Return a model's ends by tuned and by plain gradient steps and by search (tables), and its tuned steps.

    The steps are (start, point, 2) [m].
    """
    (variant, seed, s), r = job, cfg.repair
    if len(s.z) == 0:
        return *(pd.DataFrame(),) * 3, np.zeros((0, r.steps + 1, 2), np.float32)
    model = load_model(cfg, variant, s.user, seed, cfg.main_n_demos)
    repairs = repair(model, images, candidates, Ascent.of(r))  # all candidates, so that batches have one shape
    z, p = repairs.z[s.scene, s.start], repairs.p[s.scene, s.start]
    plain = repair(model, images, candidates, Ascent(steps=r.steps, optimiser="gradient", rate=r.plain_rate))
    plain_z, plain_p = plain.z[s.scene, s.start, -1], plain.p[s.scene, s.start, -1]
    log_valid = by_model(model, images)
    ends, log_p = nearest(log_valid, s.scene, s.z, float(r.distance_penalty), r.lattice_side, r.refinements)
    gradient = rows(s, "gradient", variant, seed, z[:, -1], p[:, 0], p[:, -1])
    plain = rows(s, "plain", variant, seed, plain_z, p[:, 0], plain_p)
    return gradient, plain, rows(s, "nearest", variant, seed, ends, p[:, 0], np.exp(log_p)), z


def _baselines(cfg: DictConfig, scenes: SceneSet, starts: Mapping[str, Starts]) -> list[pd.DataFrame]:
    """Return the ends of three references: a random path, the constant detour and the oracle.

    The detour is the path that is truly valid in most of a seed's training scenes. It ignores the image but knows the
    truth of every path there, not only n labels, which makes it a strong baseline.
    """
    tables = []
    for seed, s in product(cfg.protocol.seeds, [s for s in starts.values() if len(s.z)]):
        rng = stream(cfg.scenes.root_seed, "repair", "random", seed, s.user)
        detour = constant_detour(scenes.layouts[train_pool(seed)], s.margins, cfg.repair.lattice_side)
        ends = {"random_path": random_z_theta(rng, len(s.z)), "constant_detour": np.broadcast_to(detour, s.z.shape)}
        ends["oracle"] = s.nearest
        tables += [rows(s, method, "", seed, z) for method, z in ends.items()]
    return tables


def _metrics(summary: pd.DataFrame) -> dict:
    """Return the success of gradient repair and the constant detour, and SEARCHED's search measures, by user."""
    by_method = {str(method): part.set_index("user") for method, part in summary.groupby("method")}
    gradient, detour, search = (by_method[name] for name in ("gradient", "constant_detour", "nearest"))
    success = {str(variant): part["success"].to_dict() for variant, part in gradient.groupby("variant", sort=False)}
    success["constant_detour"] = detour["success"].to_dict()
    search = search.loc[search["variant"] == SEARCHED, ["success", "displacement_ratio", "unsafe"]]
    return {"repair": success, "search": {SEARCHED: search.to_dict("index")}}


if __name__ == "__main__":
    launch(main, "repair")
