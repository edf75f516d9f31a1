"""Stage demonstrations: fit the paper's model to paths as people may show them, and judge it on more of the same kind.

A kind of paths has routes (any, or few families) and a distance from the boundary of validity. Half of the paths are
valid. The scenes are those of stage scenes; new scenes are the validation pool's.
"""

from collections.abc import Iterator
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, read_position_prior, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models.baselines import NEAREST
from pipeline.training.judged_sets import (
    HELD_OUT,
    NEW,
    NEW_POOL,
    ROUTES,
    JudgedSet,
    Kinds,
    judge,
    judge_blind,
    row,
)
from pipeline.training.refit import refit

KEY = ["routes", "clear_cm", "split", "variant"]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write accuracy.parquet, summary.csv, and examples.npz: demonstrations of each kind in the first scene."""
    study, scenes = cfg.studies.demonstrations, read_scenes(Path(cfg.paths.scenes))
    scenes.check_has(NEW_POOL, *map(train_pool, cfg.protocol.seeds))
    shown = list(show_all(cfg, scenes))
    prior = read_position_prior(Path(cfg.paths.scenes))
    rows = [blind for x in shown for blind in judge_blind(prior[x.user], x)]
    seeds = list(cfg.protocol.seeds)
    fitted = {variant: [x for x in shown if x.seed in seeds[:count]] for variant, count in study.seeds.items()}
    answers = refit(cfg, fitted, partial(judge, scenes.images[NEW_POOL]), "demonstrations")
    for variant, accuracies in answers.items():
        judged = zip(fitted[variant], accuracies, strict=True)
        rows += [row(x, variant, split, right) for x, by_split in judged for split, right in by_split.items()]
    table = pd.DataFrame(rows)
    write_table(out_dir / "accuracy.parquet", table)
    write_table(out_dir / "summary.csv", summarise(table))
    first = [x for x in shown if (x.user, x.seed) == (shown[0].user, shown[0].seed)]
    examples = {"z_theta": np.stack([x.z_theta[0] for x in first]), "valid": np.stack([x.valid[0] for x in first])}
    names = np.array([f"{x.routes} {x.clear_cm}" for x in first])
    write_arrays(out_dir / "examples.npz", {"names": names, "image": first[0].images[0], **examples})


def show_all(cfg: DictConfig, scenes: SceneSet) -> Iterator[JudgedSet]:
    """Yield the demonstrations of every kind by every user in each seed's scenes."""
    kinds = Kinds(**{name: cfg.readings[name] for name in Kinds.__dataclass_fields__})
    for routes in ROUTES:
        new = kinds.draw(scenes.layouts[NEW_POOL], NEW_POOL, routes)
        for seed in cfg.protocol.seeds:
            pool = train_pool(seed)
            drawn = {HELD_OUT: (pool, kinds.draw(scenes.layouts[pool], pool, routes)), NEW: (NEW_POOL, new)}
            for clear_cm, user in product(cfg.studies.demonstrations.clear_cm, cfg.evaluate.users):
                kind, margins = (routes, clear_cm), cfg.users[user]
                yield kinds.judged_set(scenes.images[pool], drawn, kind, (user, margins), seed, cfg.main_n_demos)


def summarise(table: pd.DataFrame) -> pd.DataFrame:
    """Return mean accuracy (over users) with quartiles over seeds, and the lead over the nearest demonstration."""
    by_seed = table.groupby([*KEY, "seed"], sort=False)[["accuracy", "valid"]].mean().reset_index()
    pairs = ["routes", "clear_cm", "split", "seed"]
    nearest = by_seed[by_seed["variant"] == NEAREST][[*pairs, "accuracy"]]
    by_seed = by_seed.merge(nearest, on=pairs, how="left", suffixes=("", "_of_nearest"))
    by_seed["lead"] = by_seed["accuracy"] - by_seed["accuracy_of_nearest"]
    first, third = partial(pd.Series.quantile, q=0.25), partial(pd.Series.quantile, q=0.75)
    columns = {"accuracy": ("accuracy", "mean"), "q1": ("accuracy", first), "q3": ("accuracy", third)}
    columns |= {"lead": ("lead", "mean"), "lead_q1": ("lead", first), "lead_q3": ("lead", third)}
    columns |= {"valid": ("valid", "mean"), "seeds": ("seed", "size")}
    return by_seed.groupby(KEY, sort=False).agg(**columns).reset_index()


if __name__ == "__main__":
    launch(main, "demonstrations")
