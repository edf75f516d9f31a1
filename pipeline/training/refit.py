"""Fit variants to other training sets, as their own stages do, for studies that need only predictions."""

from collections.abc import Callable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import TypeVar

import numpy as np
from jaxtyping import Float, Float32
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.models.base import Images, ValidityModel
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed
from pipeline.training.loop import TrainingSet
from pipeline.training.trainers import trainer

Answer = TypeVar("Answer")
Sets = Mapping[str, Sequence[TrainingSet]]  # by variant


def demonstrations(cfg: DictConfig, scenes: SceneSet) -> list[TrainingSet]:
    """Return main_n_demos demonstrations a scene of each judged user and seed, in this order."""
    demos, keys = read_demos(Path(cfg.paths.demos)), product(cfg.evaluate.users, cfg.protocol.seeds)
    arrays = {(user, seed): demo_arrays(demos, seed, user, cfg.main_n_demos) for user, seed in keys}
    return [TrainingSet(user, seed, scenes.images[train_pool(seed)], *arrays[user, seed]) for user, seed in arrays]


def refit_and_predict(
    cfg: DictConfig, training_sets: Sets, images: Images, z_theta: Float[Array, "scene path 2"], desc: str
) -> dict[str, Float32[Array, "training_set scene path"]]:
    """Fit every variant to its training sets; return each model's P(valid) of every path [m] in its image."""
    p = refit(cfg, training_sets, lambda model, _: model.probability(images, z_theta), desc)
    return {variant: np.stack(p_of_variant) for variant, p_of_variant in p.items()}


def refit(
    cfg: DictConfig, training_sets: Sets, evaluate: Callable[[ValidityModel, TrainingSet], Answer], desc: str
) -> dict[str, list[Answer]]:
    """Fit every variant to its training sets; return `evaluate`(model, training set) of each; results must pickle.

    Models are seeded as in their own stage. Batches are of training sets of equally many scenes, neighbours first, for
    these may share images.
    """

    def fit(job: tuple[str, list[TrainingSet]]) -> list[Answer]:
        name, sets = job
        seeds = [job_seed(one.seed, one.user, cfg.main_n_demos, name) for one in sets]
        models, _ = trainer(cfg.variants[name], cfg).fit_new(name, cfg.variants[name].model, sets, seeds)
        return [evaluate(model, one) for model, one in zip(models, sets, strict=True)]

    batches: list[tuple[str, list[int]]] = []
    for variant, sets in training_sets.items():
        size = trainer(cfg.variants[variant], cfg).batch_size or len(cfg.protocol.seeds)
        for scenes in dict.fromkeys(len(one.images) for one in sets):
            group = [i for i, one in enumerate(sets) if len(one.images) == scenes]
            batches += [(variant, group[i : i + size]) for i in range(0, len(group), size)]
    jobs = [(variant, [training_sets[variant][i] for i in indices]) for variant, indices in batches]
    results: dict[str, dict[int, Answer]] = {variant: {} for variant in training_sets}
    fitted = map_jobs(fit, jobs, cfg.workers, desc)
    for (variant, indices), answers in zip(batches, fitted, strict=True):
        results[variant] |= zip(indices, answers, strict=True)
    return {variant: [by_index[i] for i in range(len(by_index))] for variant, by_index in results.items()}
