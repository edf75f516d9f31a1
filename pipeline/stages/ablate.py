"""Stage ablate: the path model without one ingredient at a time, fitted and judged where choices are made."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import cast

import numpy as np
from omegaconf import DictConfig

from pipeline.artifacts.demos import Queries, demo_arrays, read_labelled, read_queries
from pipeline.artifacts.files import write_json
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.causal.interventions import DIGITS
from pipeline.errors import InputError
from pipeline.launch import launch
from pipeline.parallel import map_jobs
from pipeline.spec.ablations import ABLATIONS
from pipeline.spec.clearance import ClearanceModel, fit
from pipeline.spec.descent import Schedule
from pipeline.spec.metrics import accuracy, expected_calibration_error
from pipeline.spec.specification import Specification, untrained
from pipeline.streams import job_seed

WHOLE = "whole"


@dataclass(frozen=True)
class Job:
    """One ablation's models to fit, together, and to judge."""

    cfg: DictConfig
    ablation: str
    n: int


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json: accuracy and calibration error of each ablation, and what it changes, by n."""
    _check(cfg)
    asked = list(cfg.ablate.n), list(cfg.evaluate.users), list(cfg.validation_seeds)
    jobs = [Job(cfg, name, n) for name in ABLATIONS for n in cfg.ablate.n]
    scores = np.array(map_jobs(_scores, jobs, cfg.workers, "ablations"))
    by_seed = scores.reshape(len(ABLATIONS), *map(len, asked), 2).mean(2)  # (ablation, n, seed, score): users averaged
    found = dict(zip(ABLATIONS, by_seed, strict=True))
    cells = {
        name: {f"n{n}": _cell(of[i], found[WHOLE][i]) for i, n in enumerate(cfg.ablate.n)} for name, of in found.items()
    }
    metrics = {
        "order": list(ABLATIONS),
        "ablations": cells,
        "users": list(cfg.evaluate.users),
        "seeds": len(cfg.validation_seeds),
        "pools": list(cfg.ablate.pools),
    }
    write_json(out_dir / "metrics.json", metrics)


def _check(cfg: DictConfig) -> None:
    """Raise InputError before any work if a parameter does not suit what stages before this one wrote."""
    a, scenes, queries = cfg.ablate, read_scenes(Path(cfg.paths.scenes)), read_queries(Path(cfg.paths.demos))
    needed = {*a.pools, *map(train_pool, cfg.validation_seeds)}
    scenes.check_has(*sorted(needed))
    if not all(x in queries and set(cfg.evaluate.users) <= set(queries[x].valid) for x in a.pools):
        users = ", ".join(cfg.evaluate.users)
        raise InputError(f"no queries of {users} in all of {', '.join(a.pools)}: run the demos stage again")


def _scores(job: Job) -> list[tuple[float, float]]:
    """Accuracy and calibration error of each user's and seed's model, means over the pools."""
    cfg, changed, variant = job.cfg, ABLATIONS[job.ablation], job.cfg.ablate.variant
    scenes, demos, queries = read_labelled(cfg.paths.scenes, cfg.paths.demos)
    asked = list(product(cfg.evaluate.users, cfg.validation_seeds))
    seeds = [job_seed(seed, user, job.n, variant) for user, seed in asked]  # its own stage's, whatever is missing
    models = [untrained(changed.kind, {**cfg.variants[variant].model, **changed.model}, seed) for seed in seeds]
    images = [scenes.images[train_pool(seed)] for _, seed in asked]
    z, valid = zip(*(demo_arrays(demos, seed, user, job.n) for user, seed in asked), strict=True)
    fit(cast(list[ClearanceModel], models), images, z, valid, Schedule.of(cfg.path), seeds)
    return [_judged(cfg, scenes, queries, model, user) for model, (user, _) in zip(models, asked, strict=True)]


def _judged(
    cfg: DictConfig, scenes: SceneSet, queries: dict[str, Queries], model: Specification, user: str
) -> tuple[float, float]:
    scores = []
    for pool in cfg.ablate.pools:
        answers, truth = model.probability(scenes.images[pool], queries[pool].z).ravel(), queries[pool].valid[user]
        error = expected_calibration_error(answers, truth.ravel(), cfg.evaluate.bins)
        scores.append((accuracy(answers, truth.ravel()), error))
    return tuple(np.mean(scores, 0))


def _cell(scores: np.ndarray, whole: np.ndarray) -> dict[str, float]:
    """Means over seeds of (seed, score); what changes of accuracy against the whole model, and the extremes of that."""
    change = scores[:, 0] - whole[:, 0]
    values = {
        "accuracy": scores[:, 0].mean(),
        "change": change.mean(),
        "change_low": change.min(),
        "change_high": change.max(),
        "ece": scores[:, 1].mean(),
    }
    return {name: round(float(value), DIGITS) for name, value in values.items()}


if __name__ == "__main__":
    launch(main, "ablate")
