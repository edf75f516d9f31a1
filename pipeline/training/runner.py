"""Run a training stage: list the jobs, fit them in batches, predict, and write the results.

A job is one model: a seed, a user and a number of demonstrations. One call of the variant's `Fit` fits a batch in one
process. Within a batch either all models have varying labels or none has.
"""

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, cast

import numpy as np
import pandas as pd
import torch
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import Queries, demo_arrays, read_labelled
from pipeline.artifacts.files import write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, fitted_n_demos, save_weights, weights_path
from pipeline.artifacts.scenes import train_pool
from pipeline.models.base import ValidityModel, untrained
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed
from pipeline.training.loop import Checkpoints, is_constant

KEY = ["seed", "user", "n_demos"]
MIN_OWN_DEMONSTRATIONS = 0.995  # share judged right that a converged model reaches
# (models, images, z_theta, valid, seeds=, checkpoints=) -> learning curves; must pickle
Fit = Callable[..., list[np.ndarray]]


@dataclass(frozen=True)
class Job:
    """One model to fit; its data are read once per process (`read_labelled`)."""

    seed: int
    user: str
    n_demos: int
    variant: str
    settings: dict  # conf/variants/<variant>
    kind: type[ValidityModel]
    fit: Fit
    pools: dict[str, str]  # split -> pool of scenes that it is evaluated in
    scenes_dir: str
    demos_dir: str
    checkpoints: tuple[int, ...]  # steps before which its weights are also kept

    @property
    def key(self) -> tuple[int, str, int]:
        """Return (seed, user, n_demos)."""
        return self.seed, self.user, self.n_demos


@dataclass(frozen=True)
class Fitted:
    """The results of a job, as arrays."""

    job: Job
    weights: dict[str, np.ndarray]
    checkpoints: dict[int, dict[str, np.ndarray]]  # step -> weights
    curve: np.ndarray  # (point, column)
    predictions: dict[str, np.ndarray]  # split -> P(valid) (scene, query)
    convergence: dict[str, Any]  # reconstruction_over_flat, own_demonstrations and passed


def variant_settings(cfg: DictConfig, stage: str) -> dict[str, Any]:
    """Return the settings of `cfg.variant`; raise InputError if it belongs to another stage."""
    variant = cfg.variants[cfg.variant]
    if variant.stage != stage:
        expected = [name for name, v in cfg.variants.items() if v.stage == stage]
        raise InputError(f"variant {cfg.variant} is not fitted by stage {stage}: expected one of {', '.join(expected)}")
    return cast(dict[str, Any], OmegaConf.to_container(variant, resolve=True))


def fit_variant(
    cfg: DictConfig,
    out_dir: Path,
    settings: dict,
    kind: type[ValidityModel],
    fit: Fit,
    columns: Sequence[str],
    batch_size: int | None,
) -> None:
    """Fit `cfg.variant` for every seed, user and number of demonstrations; write all files under `out_dir` at the end.

    `columns`: columns of the learning curves, the first one `step`. `batch_size`: models per batch; None: all of a
    seed.
    """
    jobs = _jobs(cfg, settings, kind, fit)
    queries = _check_inputs(jobs)
    batches = map_jobs(_fit_and_predict, _batches(jobs, batch_size, cfg.workers), cfg.workers, f"fit {cfg.variant}")
    by_key = {fitted.job.key: fitted for batch in batches for fitted in batch}
    _write(out_dir, [by_key[job.key] for job in jobs], queries, columns)


def _jobs(cfg: DictConfig, settings: dict, kind: type[ValidityModel], fit: Fit) -> list[Job]:
    """Return all models of this run."""
    seeds = list(cfg.protocol.seeds) if cfg.seed is None else [cfg.seed]
    return [
        Job(
            seed, user, n_demos, cfg.variant, settings, kind, fit,
            {split: pool or train_pool(seed) for split, pool in cfg.protocol.splits.items()},
            cfg.paths.scenes, cfg.paths.demos, tuple(cfg.checkpoints) if n_demos == cfg.main_n_demos else (),
        )
        for seed in seeds for user in cfg.users for n_demos in fitted_n_demos(cfg, cfg.variant)
    ]  # fmt: skip


def _check_inputs(jobs: list[Job]) -> dict[str, Queries]:
    """Check that every job has its scenes, demonstrations and queries; return the queries by pool."""
    scenes, demos, queries = read_labelled(jobs[0].scenes_dir, jobs[0].demos_dir)
    for job in jobs:
        scenes.check_has(train_pool(job.seed), *job.pools.values())
        for pool in job.pools.values():
            if pool not in queries or job.user not in queries[pool].valid:
                raise InputError(f"no queries of {job.user} in {pool}: run `dvc repro demos`")
        z, _ = demo_arrays(demos, job.seed, job.user, job.n_demos)
        expected = len(scenes.images[train_pool(job.seed)])
        if len(z) != expected:
            raise InputError(
                f"{len(z)} scenes with demonstrations of {job.user}, seed {job.seed}: expected {expected}; "
                "run `dvc repro demos`"
            )
    return queries


def _batches(jobs: list[Job], batch_size: int | None, workers: int) -> list[list[Job]]:
    """Return the batches of jobs; jobs with equal labels come last.

    Models of a batch have similar numbers of demonstrations; the longest batch comes first. Without `batch_size`, a
    seed's models share one process and its cache, unless that would leave processes idle.
    """
    demos = read_labelled(jobs[0].scenes_dir, jobs[0].demos_dir)[1]
    groups: dict[bool, list[Job]] = {False: [], True: []}
    for job in jobs:
        groups[is_constant(demo_arrays(demos, *job.key)[1])].append(job)
    if batch_size is None:
        by_seed = len({job.seed for job in jobs}) >= workers
        return [
            list(batch)
            for group in groups.values()
            for _, batch in groupby(group, key=lambda job: job.seed if by_seed else job.key)
        ]
    longest_first = [sorted(group, key=lambda job: -job.n_demos) for group in groups.values()]
    return [group[i : i + batch_size] for group in longest_first for i in range(0, len(group), batch_size)]


def _fit_and_predict(batch: list[Job]) -> list[Fitted]:
    """Fit one batch, then predict the queries of every split."""
    scenes, demos, queries = read_labelled(batch[0].scenes_dir, batch[0].demos_dir)
    seeds = [job_seed(*job.key, job.variant) for job in batch]
    models = [untrained(job.kind, job.settings["model"], seed) for job, seed in zip(batch, seeds, strict=True)]
    images = [scenes.images[train_pool(job.seed)] for job in batch]
    z, valid = zip(*(demo_arrays(demos, *job.key) for job in batch), strict=True)
    checkpoints = Checkpoints(step for job in batch for step in job.checkpoints)
    curves = batch[0].fit(models, images, z, valid, seeds=seeds, checkpoints=checkpoints)
    results = []
    for i, (job, model, curve) in enumerate(zip(batch, models, curves, strict=True)):
        need_finite(curve, f"{job.variant} of {job.user}, seed {job.seed}, n_demos {job.n_demos}")
        p = {split: model.probability(scenes.images[pool], queries[pool].z) for split, pool in job.pools.items()}
        weights = {name: value.numpy() for name, value in model.state_dict().items()}
        kept = checkpoints.of(model) if job.checkpoints else {}
        convergence = _convergence(model, images[i], z[i], valid[i], has_decoder=bool(job.settings.get("alpha")))
        results.append(Fitted(job, weights, kept, curve, p, convergence))
    return results


def _convergence(model: ValidityModel, images, z_theta, valid, has_decoder: bool) -> dict[str, Any]:
    """Return whether the model reconstructs its training images and judges its own demonstrations right.

    The encoder of constant labels is never trained: no ratio.
    """
    ratio = model.reconstruction_over_flat(images) if has_decoder and not is_constant(valid) else np.nan
    share = float(((model.probability(images, z_theta) > 0.5) == valid).mean())
    passed = share >= MIN_OWN_DEMONSTRATIONS and not ratio >= 1
    return {"reconstruction_over_flat": ratio, "own_demonstrations": share, "passed": passed}


def need_finite(curve: np.ndarray, model: str) -> None:
    """Raise InputError, naming the `model`, if its learning curve (point, column) diverged; column 0: step."""
    if not np.isfinite(curve).all():
        step = int(curve[~np.isfinite(curve).all(1)][0, 0])
        raise InputError(f"{model}: its loss is no longer finite at step {step}; lower the learning rate of its stage")


def _write(out_dir: Path, fitted: list[Fitted], queries: dict[str, Queries], columns: Sequence[str]) -> None:
    """Write weights/, checkpoints/, predictions, curves, their means over seeds (curves.csv) and convergence.csv."""
    predictions = pd.concat([_prediction_rows(f, queries) for f in fitted], ignore_index=True)
    curves = pd.concat([_curve_rows(f, columns) for f in fitted], ignore_index=True)
    for folder in ("weights", "checkpoints"):  # remove the models of an earlier run
        shutil.rmtree(out_dir / folder, ignore_errors=True)
        (out_dir / folder).mkdir(parents=True)  # even if no model has any
    for f in fitted:
        for step, weights in {None: f.weights, **f.checkpoints}.items():
            path = weights_path(out_dir, f.job.user, f.job.seed, f.job.n_demos, step)
            save_weights(path, {name: torch.from_numpy(value) for name, value in weights.items()})
    write_table(out_dir / "predictions.parquet", predictions)
    convergence = [dict(zip(KEY, f.job.key, strict=True)) | f.convergence for f in fitted]
    write_table(out_dir / "convergence.csv", pd.DataFrame(convergence))
    write_table(out_dir / "curves.parquet", curves)
    means = curves.groupby(["user", "n_demos", "step"], as_index=False)[list(columns[1:])].mean()
    write_table(out_dir / "curves.csv", means)


def _prediction_rows(fitted: Fitted, queries: dict[str, Queries]) -> pd.DataFrame:
    """Return one row per query of every split, with the true label."""
    parts = []
    for split, p in fitted.predictions.items():
        scene, query = np.indices(p.shape)
        truth = queries[fitted.job.pools[split]].valid[fitted.job.user]
        columns = {"scene": scene.ravel(), "query": query.ravel(), "p": p.ravel(), "valid": truth.ravel()}
        parts.append(pd.DataFrame(columns).assign(split=split))
    rows = pd.concat(parts, ignore_index=True)
    return rows.assign(**dict(zip(KEY, fitted.job.key, strict=True)))[PREDICTION_COLUMNS]


def _curve_rows(fitted: Fitted, columns: Sequence[str]) -> pd.DataFrame:
    """Return one row per point of the learning curve."""
    curve = pd.DataFrame(fitted.curve, columns=list(columns)).astype({"step": int})
    return curve.assign(**dict(zip(KEY, fitted.job.key, strict=True)))[KEY + list(columns)]
