"""Stage repair: turn invalid paths into valid ones by gradient steps and by search, with baselines and the oracle."""

from collections.abc import Mapping
from functools import partial
from itertools import chain, product
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
from pipeline.stats.crossed import items_held
from pipeline.world.bezier import random_z_theta
from pipeline.world.rules import valid

DRAWN = "full"  # the variant whose steps from the same starts a figure shows
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
    invalid = {user: ~valid(layouts, candidates, margins) for user, margins in cfg.users.items()}
    to_any, first = np.any(list(invalid.values()), axis=0), np.indices(candidates.shape[:2])[1]
    every = {user: Starts.of(user, margins, *given, first >= 0) for user, margins in cfg.users.items()}
    starts = {user: some.select(invalid[user]) for user, some in every.items()}
    shared = {user: some.select(to_any) for user, some in every.items()}
    anywhere = {user: some.select(first == 0) for user, some in every.items()}
    if not to_any.any():
        raise InputError(f"no user has an invalid path among those drawn in {pool}: raise repair.starts")
    models = list(product(cfg.variants, cfg.users, cfg.protocol.seeds))
    jobs = [(variant, seed, starts[user], shared[user], anywhere[user]) for variant, user, seed in models]
    repairs = map_jobs(partial(_repair, cfg, scenes.images[pool], candidates), jobs, cfg.workers, "repairs")
    of_models, paths, drawn = zip(*repairs, strict=True)
    tables = [*chain(*of_models), *_baselines(cfg, scenes, starts)]
    table = pd.concat([t for t in tables if len(t)], ignore_index=True)
    summary = measures(table, items_held(layouts.item, layouts.symbol) if r.split == UNSEEN else None)
    write_table(out_dir / "repairs.parquet", table)
    own = {model_name(*key): z for key, z in zip(models, paths, strict=True)}
    same_starts = {f"same_starts-{key[1]}": z for key, z in zip(models, drawn, strict=True) if z is not None}
    write_arrays(out_dir / "paths.npz", own | same_starts)
    write_table(out_dir / "summary.csv", summary)
    write_json(out_dir / "metrics.json", _metrics(summary))


def _repair(
    cfg: DictConfig, images: Array, candidates: Array, job: tuple[str, int, Starts, Starts, Starts]
) -> tuple[list[pd.DataFrame], Array, Array | None]:
    """Return a model's ends, a table a method, and its gradient steps from the user's starts (start, point, 2) [m].

    Last, of the first seed's model of the paper, those from the starts of all users; None of others.
    The methods: gradient steps; those from the starts of all users; the paper's plain steps; the search; and IRL's own
    policy, the path of highest return in each scene, wherever it starts.
    """
    (variant, seed, own, shared, anywhere), r = job, cfg.repair
    model = load_model(cfg, variant, own.user, seed, cfg.main_n_demos)
    tuned = repair(model, images, candidates, Ascent.of(r))  # all candidates, so that batches have one shape
    plain = Ascent(steps=r.steps, optimiser="gradient", rate=r.plain_rate)
    steps = {"gradient": (own, tuned), "same_starts": (shared, tuned)}
    if len(own.z):
        steps["plain"] = own, repair(model, images, candidates, plain)
    tables = []
    for method, (starts, made) in steps.items():
        z, p = made.z[starts.scene, starts.start], made.p[starts.scene, starts.start]
        tables.append(rows(starts, method, variant, seed, z[:, -1], p[:, 0], p[:, -1]))
    searches = {"nearest": (own, float(r.distance_penalty))} if len(own.z) else {}
    if cfg.variants[variant].stage == "irl":
        searches["policy"] = anywhere, 0.0
    for method, (starts, penalty) in searches.items():
        found = nearest(by_model(model, images), starts.scene, starts.z, penalty, r.lattice_side, r.refinements)
        p_start = tuned.p[starts.scene, starts.start, 0]
        tables.append(rows(starts, method, variant, seed, found[0], p_start, np.exp(found[1])))
    drawn = (variant, seed) == (DRAWN, cfg.protocol.seeds[0])
    return tables, tuned.z[own.scene, own.start], tuned.z[shared.scene, shared.start] if drawn else None


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
