"""Fit the models of stages train, irl and clearance: list them, fit them in batches, and write their files.

A model has a seed, a user and a number of demonstrations. One process fits a batch by one call. Within a batch either
all models have varying labels or none has.
"""

import shutil
from collections.abc import Callable, Mapping
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import asked, demo_arrays, read_labelled
from pipeline.artifacts.files import write_table
from pipeline.artifacts.models import PREDICTION_COLUMNS, fitted_n_demos, save_weights, weights_path
from pipeline.artifacts.scenes import train_pool
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed
from pipeline.training.loop import Checkpoints, Trainer, TrainingSet, convergence, is_constant

KEY = ["seed", "user", "n_demos"]
Key = tuple[int, str, int]


# What is written of one model: weights by the step before which they were kept (None: after the last), learning curve
# (point, column), P(valid) (scene, query) by split, and whether it converged.
Fitted = tuple[dict[int | None, dict[str, Array]], Array, dict[str, Array], dict[str, Any]]


def fit_variant(cfg: DictConfig, out_dir: Path, trainer_of: Callable[[Mapping, Mapping], Trainer]) -> None:
    """Fit `cfg.variant` for every seed, user and number of demonstrations; write all files under `out_dir` at the end.

    trainer_of: settings of variant and stage -> how it is fitted. Raises InputError for missing scenes, demonstrations
    or queries, before any is fitted.
    """
    variant = cfg.variants[cfg.variant]
    trainer = trainer_of(variant, cfg[variant.stage])
    seeds = list(cfg.protocol.seeds) if cfg.seed is None else [cfg.seed]
    keys = [(seed, user, n) for seed in seeds for user in cfg.users for n in fitted_n_demos(cfg, cfg.variant)]
    batches = _batches(cfg, keys, trainer.batch_size)
    results = map_jobs(partial(_fit, cfg, trainer), batches, cfg.workers, f"fit {cfg.variant}")
    fitted = {key: one for batch, of in zip(batches, results, strict=True) for key, one in zip(batch, of, strict=True)}
    _write(cfg, out_dir, {key: fitted[key] for key in keys}, list(trainer.columns))


def _batches(cfg: DictConfig, keys: list[Key], batch_size: int | None) -> list[list[Key]]:
    """Return the batches of models; those with equal labels come last.

    Models of a batch have similar numbers of demonstrations; the longest batch comes first. Without `batch_size`, a
    seed's models share one process and its cache, unless that would leave processes idle.
    """
    groups: dict[bool, list[Key]] = {False: [], True: []}
    for seed, user, n in keys:
        _queries(cfg, seed, user)  # so that what is missing is named before any model is fitted
        groups[is_constant(_training_set(cfg, seed, user, n).valid)].append((seed, user, n))
    if batch_size is None:
        by_seed = len({seed for seed, _, _ in keys}) >= cfg.workers
        process = (lambda key: key[0]) if by_seed else None
        return [list(batch) for group in groups.values() for _, batch in groupby(group, process)]
    longest_first = [sorted(group, key=lambda key: -key[2]) for group in groups.values()]
    return [group[i : i + batch_size] for group in longest_first for i in range(0, len(group), batch_size)]


def _training_set(cfg: DictConfig, seed: int, user: str, n_demos: int) -> TrainingSet:
    """Return one model's data, read once per process; raise InputError if a scene or demonstration is missing."""
    scenes, demos, _ = read_labelled(cfg.paths.scenes, cfg.paths.demos)
    scenes.check_has(train_pool(seed))
    images, (z, valid) = scenes.images[train_pool(seed)], demo_arrays(demos, seed, user, n_demos)
    if len(z) != len(images):
        found = f"{len(z)} scenes with demonstrations of {user}, seed {seed}"
        raise InputError(f"{found}: expected {len(images)}; run `dvc repro demos`")
    return TrainingSet(user, seed, images, z, valid)


def _queries(cfg: DictConfig, seed: int, user: str) -> dict[str, tuple[Array, Array, Array]]:
    """Return images, paths [m] and labels (scene, query) by split; raise InputError if any is missing."""
    scenes, _, queries = read_labelled(cfg.paths.scenes, cfg.paths.demos)
    pools = {split: pool or train_pool(seed) for split, pool in cfg.protocol.splits.items()}
    scenes.check_has(*pools.values())
    return {split: (scenes.images[pool], *asked(queries, pool, user)) for split, pool in pools.items()}


def _fit(cfg: DictConfig, trainer: Trainer, batch: list[Key]) -> list[Fitted]:
    """Fit one batch, then predict the queries of every split."""
    variant, name = cfg.variants[cfg.variant], cfg.variant
    training_sets, seeds = [_training_set(cfg, *key) for key in batch], [job_seed(*key, name) for key in batch]
    studied = [n == cfg.main_n_demos for _, _, n in batch]  # those of which weights on the way are kept
    checkpoints = Checkpoints(cfg.checkpoints if any(studied) else ())
    models, curves = trainer.fit_new(name, variant.model, training_sets, seeds, checkpoints)
    has_decoder, results = "alpha" in variant and variant.alpha > 0, []
    for i, (model, curve) in enumerate(zip(models, curves, strict=True)):
        queries = _queries(cfg, *batch[i][:2])
        p = {split: model.probability(images, z) for split, (images, z, _) in queries.items()}
        weights = {None: {name: value.numpy() for name, value in model.state_dict().items()}}
        kept = checkpoints.of(model) if studied[i] else {}
        results.append((weights | kept, curve, p, convergence(model, training_sets[i], has_decoder)))
    return results


def _write(cfg: DictConfig, out_dir: Path, fitted: dict[Key, Fitted], columns: list[str]) -> None:
    """Write weights/, checkpoints/, predictions, curves, their means over seeds (curves.csv) and convergence.csv."""
    predictions, curves, gates = [], [], []
    for folder in ("weights", "checkpoints"):  # remove the models of an earlier run
        shutil.rmtree(out_dir / folder, ignore_errors=True)
        (out_dir / folder).mkdir(parents=True)  # even if no model has any
    for (seed, user, n), (states, curve, predicted, gate) in fitted.items():
        named, queries = dict(zip(KEY, (seed, user, n), strict=True)), _queries(cfg, seed, user)
        for split, p in predicted.items():
            scene, query = np.indices(p.shape).reshape(2, -1)
            rows = {"scene": scene, "query": query, "p": p.ravel(), "valid": queries[split][2].ravel()}
            predictions.append(pd.DataFrame(rows).assign(split=split, **named))
        curves.append(pd.DataFrame(curve, columns=columns).astype({"step": int}).assign(**named))
        gates.append(named | gate)
        for step, weights in states.items():
            path = weights_path(out_dir, user, seed, n, step)
            save_weights(path, {name: torch.from_numpy(value) for name, value in weights.items()})
    write_table(out_dir / "predictions.parquet", pd.concat(predictions, ignore_index=True)[PREDICTION_COLUMNS])
    write_table(out_dir / "convergence.csv", pd.DataFrame(gates))
    points = pd.concat(curves, ignore_index=True)[[*KEY, *columns]]
    write_table(out_dir / "curves.parquet", points)
    means = points.groupby(["user", "n_demos", "step"], as_index=False)[columns[1:]].mean()
    write_table(out_dir / "curves.csv", means)
