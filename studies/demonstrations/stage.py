"""Stage demonstrations: fit the paper's model to paths as people may show them, and judge it on more of the same kind.

A kind of paths has routes (any, or few families) and a distance from the boundary of validity. Half of the paths are
valid. The scenes are those of stage scenes; new scenes are the validation pool's.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, read_position_prior, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import NEAREST, POSITION
from pipeline.runtime.streams import stream
from pipeline.stats.scores import accuracy
from pipeline.training.refit import TrainingSet, refit
from pipeline.world.bezier import random_z_theta
from pipeline.world.clear_cases import Candidates

ANY, FEW = ROUTES = "any", "few"
OWN, HELD_OUT, NEW = "demonstrations", "held_out", "new_scenes"
NEW_POOL = "val_scenes"
KEY = ["routes", "clear_cm", "split", "variant"]
Labelled = tuple[Float[Array, "scene path 2"], Bool[Array, "scene path"]]


@dataclass(frozen=True)
class Shown(TrainingSet):
    """Demonstrations of one kind, and paths of the same kind that judge a model by split."""

    routes: str
    clear_cm: int
    judged: dict[str, Labelled]


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


def show_all(cfg: DictConfig, scenes: SceneSet) -> Iterator[Shown]:
    """Yield the demonstrations of every kind by every user in each seed's scenes.

    Users and distances share their candidates, so that kinds differ by nothing else.
    """
    study, n = cfg.studies.demonstrations, cfg.main_n_demos
    for routes in ROUTES:
        new = _candidates(cfg, scenes, NEW_POOL, routes)
        for seed in cfg.protocol.seeds:
            pool = train_pool(seed)
            seen = _candidates(cfg, scenes, pool, routes)
            for clear_cm, user in product(study.clear_cm, cfg.evaluate.users):
                z, valid = choose(cfg, pool, seen, user, clear_cm, n + study.held_out)
                judged = {
                    OWN: (z[:, :n], valid[:, :n]),
                    HELD_OUT: (z[:, n:], valid[:, n:]),
                    NEW: choose(cfg, NEW_POOL, new, user, clear_cm, study.held_out),
                }
                yield Shown(user, seed, scenes.images[pool], *judged[OWN], routes, clear_cm, judged)


def _candidates(cfg: DictConfig, scenes: SceneSet, pool: str, routes: str) -> Candidates:
    """Draw random paths of these routes in each scene."""
    study, layouts = cfg.studies.demonstrations, scenes.layouts[pool]
    rng = stream(study.root_seed, routes, pool)
    shape = len(layouts), study.candidates
    z = random_z_theta(rng, *shape)
    if routes == FEW:
        centre = np.array(study.families, float)[rng.integers(len(study.families), size=shape)]
        bearing, reach = rng.uniform(-np.pi, np.pi, shape), study.family_radius * np.sqrt(rng.random(shape))
        z = centre + reach[..., None] * np.stack([np.cos(bearing), np.sin(bearing)], -1)
    return Candidates.of(layouts, z)


def choose(cfg: DictConfig, pool: str, candidates: Candidates, user: str, clear_cm: int, count: int) -> Labelled:
    """Choose `count` candidates in each scene that are clear cases to the user; return them with their labels."""
    rng = stream(cfg.studies.demonstrations.root_seed, "choose", pool, user, clear_cm)
    return candidates.choose(rng, cfg.users[user], clear_cm / 100, count)


def judge(new_images: UInt8[Array, "scene 100 100 3"], model: ValidityModel, shown: TrainingSet) -> dict[str, float]:
    """Return the model's accuracy in each split."""
    assert isinstance(shown, Shown)
    images = {OWN: shown.images, HELD_OUT: shown.images, NEW: new_images}
    return {s: accuracy(model.probability(images[s], z).ravel(), v.ravel()) for s, (z, v) in shown.judged.items()}


def judge_blind(prior: Float[Array, "side side"], shown: Shown) -> Iterator[dict]:
    """Yield the accuracy of both image-blind baselines."""
    for split, (z, valid) in shown.judged.items():
        p = {POSITION: baselines.position_only_of_half(prior, z)}
        if split == HELD_OUT:
            p[NEAREST] = baselines.nearest_demonstration(shown.z_theta, shown.valid, z)
        for variant, of_variant in p.items():
            yield row(shown, variant, split, accuracy(of_variant.ravel(), valid.ravel()))


def row(shown: Shown, variant: str, split: str, right: float) -> dict:
    """Return a row of accuracy.parquet; `valid`: share of the judged paths that are valid."""
    key = {"routes": shown.routes, "clear_cm": shown.clear_cm, "split": split, "variant": variant}
    return key | {"user": shown.user, "seed": shown.seed, "accuracy": right, "valid": shown.judged[split][1].mean()}


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
