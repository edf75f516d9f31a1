"""What the stages that fit models share: one job for every (seed, user, n), its predictions, and the files written.

A job is a model built from the variant's settings, a `fit` that trains it in place, and its judgement of the queries.
A `fit` takes a batch of jobs: either every one's labels vary, or none's do.
"""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import torch
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import Queries, demo_arrays, read_labelled
from pipeline.artifacts.files import write_json, write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, save_weights, weights_path
from pipeline.artifacts.scenes import train_pool
from pipeline.models.base import ValidityModel, untrained
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed
from pipeline.training.loop import Checkpoints, is_constant

KEY = ["seed", "user", "n_demos"]
# (models, images, z_theta, valid, seeds=, checkpoints=) -> learning curves; picklable
Fit = Callable[..., list[np.ndarray]]


@dataclass(frozen=True)
class Job:
    """One model to fit; what it needs besides is read once per process (`read_labelled`)."""

    seed: int
    user: str
    n: int
    variant: str
    settings: dict  # conf/variants/<variant>
    kind: type[ValidityModel]
    fit: Fit
    pools: dict[str, str]  # split -> pool of scenes that judges it
    scenes_dir: str
    demos_dir: str
    checkpoints: tuple[int, ...]  # steps before which its weights are kept as well


@dataclass(frozen=True)
class Fitted:
    """What a job hands back, as arrays: weights, those on the way, learning curve and the predictions of each split."""

    job: Job
    weights: dict[str, np.ndarray]
    checkpoints: dict[int, dict[str, np.ndarray]]  # step -> weights
    curve: np.ndarray  # (point, column)
    predictions: dict[str, np.ndarray]  # split -> (scene, query)


def variant_settings(cfg: DictConfig, stage: str) -> dict[str, Any]:
    """The settings of `cfg.variant`; InputError if another stage fits it."""
    variant = cfg.variants[cfg.variant]
    if variant.stage != stage:
        own = [name for name, v in cfg.variants.items() if v.stage == stage]
        raise InputError(f"variant {cfg.variant} is not fitted by stage {stage}: expected one of {', '.join(own)}")
    return cast(dict[str, Any], OmegaConf.to_container(variant, resolve=True))


def fit_sequentially(
    fit: Callable[..., np.ndarray], models, images, z_theta, valid, seeds, **settings
) -> list[np.ndarray]:
    """A `fit` of one model at a time (model, images, z_theta, valid, seed=, **settings), for several."""
    jobs = zip(models, images, z_theta, valid, seeds, strict=True)
    return [fit(*arguments, seed=seed, **settings) for *arguments, seed in jobs]


def fit_variant(
    cfg: DictConfig,
    out_dir: Path,
    settings: dict,
    kind: type[ValidityModel],
    fit: Fit,
    columns: Sequence[str],
    batch_size: int = 1,
) -> None:
    """Fit `cfg.variant` for every seed, user and n, `batch_size` together, and write its files under `out_dir` at the end.

    `columns`: of the learning curves, the first one `step`. Files: weights/, checkpoints/ (main_n_demos's models before
    each step of `cfg.checkpoints`), predictions.parquet, curves.parquet, curves.csv (mean over seeds) and metrics.json.
    """
    jobs = _jobs(cfg, settings, kind, fit)
    queries = _check_inputs(jobs)
    batches = map_jobs(_run, _batches(jobs, batch_size), cfg.workers, f"fit {cfg.variant}")
    by_key = {_key(f.job): f for batch in batches for f in batch}
    fitted = [by_key[_key(job)] for job in jobs]
    predictions = pd.concat([_prediction_rows(f, queries) for f in fitted], ignore_index=True)
    curves = pd.concat([_curve_rows(f, columns) for f in fitted], ignore_index=True)
    for folder in ("weights", "checkpoints"):  # models of an earlier run into the same folder are not this one's
        shutil.rmtree(out_dir / folder, ignore_errors=True)
        (out_dir / folder).mkdir(parents=True)  # even where no model has any
    for f in fitted:
        for step, weights in {None: f.weights, **f.checkpoints}.items():
            path = weights_path(out_dir, f.job.user, f.job.seed, f.job.n, step)
            save_weights(path, {name: torch.from_numpy(value) for name, value in weights.items()})
    write_table(out_dir / "predictions.parquet", predictions)
    write_table(out_dir / "curves.parquet", curves)
    means = curves.groupby(["user", "n_demos", "step"], as_index=False)[list(columns[1:])].mean()
    write_table(out_dir / "curves.csv", means)
    write_json(out_dir / "metrics.json", {"accuracy": {cfg.variant: accuracy(predictions)}})


def accuracy(predictions: pd.DataFrame) -> dict[str, dict[str, dict[str, float]]]:
    """user -> split -> n -> the share of queries judged rightly (p > .5), mean over seeds."""
    right = (predictions["p"] > 0.5) == predictions["valid"]
    by_seed = right.groupby([predictions[c] for c in ("user", "split", "n_demos", "seed")]).mean()
    table: dict[str, dict[str, dict[str, float]]] = {}
    for (user, split, n), value in by_seed.groupby(level=["user", "split", "n_demos"]).mean().items():  # pyright: ignore
        table.setdefault(user, {}).setdefault(split, {})[f"n{n}"] = round(float(value), 4)
    return table


def _jobs(cfg: DictConfig, settings: dict, kind: type[ValidityModel], fit: Fit) -> list[Job]:
    """Every model this run fits."""
    seeds = list(cfg.protocol.seeds) if cfg.seed is None else [cfg.seed]
    return [
        Job(
            seed, user, n, cfg.variant, settings, kind, fit,
            {split: pool or train_pool(seed) for split, pool in cfg.protocol.splits.items()},
            cfg.paths.scenes, cfg.paths.demos, tuple(cfg.checkpoints) if n == cfg.main_n_demos else (),
        )
        for seed in seeds for user in cfg.users for n in cfg.n_demos
    ]  # fmt: skip


def _check_inputs(jobs: list[Job]) -> dict[str, Queries]:
    """Every pool a job needs is there before the first one starts; the queries come back."""
    scenes, demos, queries = read_labelled(jobs[0].scenes_dir, jobs[0].demos_dir)
    for job in jobs:
        scenes.check_has(train_pool(job.seed), *job.pools.values())
        for pool in job.pools.values():
            if pool not in queries or job.user not in queries[pool].valid:
                raise InputError(f"no queries of {job.user} in {pool}: run `dvc repro demos`")
        z, _ = demo_arrays(demos, job.seed, job.user, job.n)
        if len(z) != len(scenes.images[train_pool(job.seed)]):
            raise InputError(
                f"{len(z)} scenes with demonstrations of {job.user}, seed {job.seed}: expected "
                f"{len(scenes.images[train_pool(job.seed)])}; run `dvc repro demos`"
            )
    return queries


def _batches(jobs: list[Job], batch_size: int) -> list[list[Job]]:
    """Jobs to fit together, of about the same n; those whose labels never vary cost nothing, apart.

    Jobs fitted alone keep their order, seed by seed: what models of a seed share then stays cached.
    """
    varied: list[Job] = []
    constant: list[Job] = []
    for job in sorted(jobs, key=lambda job: job.n if batch_size > 1 else 0):
        _, valid = demo_arrays(read_labelled(job.scenes_dir, job.demos_dir)[1], job.seed, job.user, job.n)
        (constant if is_constant(valid) else varied).append(job)
    return [group[i : i + batch_size] for group in (varied, constant) for i in range(0, len(group), batch_size)]


def _run(batch: list[Job]) -> list[Fitted]:
    """One batch, in a process of its own: fit, then judge the queries of every split."""
    scenes, demos, queries = read_labelled(batch[0].scenes_dir, batch[0].demos_dir)
    seeds = [job_seed(job.seed, job.user, job.n, job.variant) for job in batch]
    models = [untrained(job.kind, job.settings["model"], seed) for job, seed in zip(batch, seeds, strict=True)]
    images = [scenes.images[train_pool(job.seed)] for job in batch]
    z, valid = zip(*(demo_arrays(demos, job.seed, job.user, job.n) for job in batch), strict=True)
    checkpoints = Checkpoints(step for job in batch for step in job.checkpoints)
    curves = batch[0].fit(models, images, z, valid, seeds=seeds, checkpoints=checkpoints)
    fitted = []
    for job, model, curve in zip(batch, models, curves, strict=True):
        need_finite(curve, f"{job.variant} of {job.user}, seed {job.seed}, n {job.n}")
        judged = {split: model.probability(scenes.images[pool], queries[pool].z) for split, pool in job.pools.items()}
        weights = {name: value.numpy() for name, value in model.state_dict().items()}
        on_the_way = checkpoints.of(model) if job.checkpoints else {}
        fitted.append(Fitted(job, weights, on_the_way, curve, judged))
    return fitted


def need_finite(curve: np.ndarray, model: str) -> None:
    """Raise InputError, which names the `model`, if its learning curve (point, column) diverged; column 0: step."""
    if not np.isfinite(curve).all():
        step = int(curve[~np.isfinite(curve).all(1)][0, 0])
        raise InputError(f"{model}: its loss is no longer finite at step {step}; lower the learning rate of its stage")


def _prediction_rows(fitted: Fitted, queries: dict[str, Queries]) -> pd.DataFrame:
    """One row per query of every split, beside the truth."""
    parts = []
    for split, p in fitted.predictions.items():
        scene, query = np.indices(p.shape)
        truth = queries[fitted.job.pools[split]].valid[fitted.job.user]
        columns = {"scene": scene.ravel(), "query": query.ravel(), "p": p.ravel(), "valid": truth.ravel()}
        parts.append(pd.DataFrame(columns).assign(split=split))
    return _keyed(pd.concat(parts, ignore_index=True), fitted.job)[PREDICTION_COLUMNS]


def _curve_rows(fitted: Fitted, columns: Sequence[str]) -> pd.DataFrame:
    """One row per point of the learning curve."""
    curve = pd.DataFrame(fitted.curve, columns=list(columns)).astype({"step": int})
    return _keyed(curve, fitted.job)[KEY + list(columns)]


def _key(job: Job) -> tuple[int, str, int]:
    return job.seed, job.user, job.n


def _keyed(rows: pd.DataFrame, job: Job) -> pd.DataFrame:
    return rows.assign(seed=job.seed, user=job.user, n_demos=job.n)
