"""Fit variants to other training sets, as their own stages do, for studies that need only predictions.

VAEs are fitted by the simd engine, regardless of `train.engine`.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.models.base import ValidityModel, untrained
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.irl.reward_map import RewardMap
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed
from pipeline.training.clearance import fit as clearance
from pipeline.training.irl import fit as irl
from pipeline.training.loop import Schedule, fit_sequentially
from pipeline.training.runner import Fit, need_finite
from pipeline.training.vae.engines.simd import LANES, fit_stack

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class TrainingSet:
    """One user's demonstrations in one seed's scenes: the data that one model is fitted to."""

    user: str
    seed: int
    images: UInt8[Array, "scene 100 100 3"]
    z_theta: Float[Array, "scene n 2"]  # [m]
    valid: Bool[Array, "scene n"]


def refit_and_predict(
    cfg: DictConfig,
    training_sets: Mapping[str, Sequence[TrainingSet]],
    images: UInt8[Array, "image 100 100 3"],
    z_theta: Float[Array, "image path 2"],
    desc: str,
) -> dict[str, Float32[Array, "training_set image path"]]:
    """Fit every variant to its training sets; return each model's P(valid) of every path [m] in its image."""
    p = refit(cfg, training_sets, partial(_predict, images, z_theta), desc)
    return {variant: np.stack(p_of_variant) for variant, p_of_variant in p.items()}


def _predict(images: Array, z_theta: Array, model: ValidityModel, _: TrainingSet) -> Float32[Array, "image path"]:
    return model.probability(images, z_theta)


def refit(
    cfg: DictConfig,
    training_sets: Mapping[str, Sequence[TrainingSet]],
    evaluate: Callable[[ValidityModel, TrainingSet], Answer],
    desc: str,
) -> dict[str, list[Answer]]:
    """Fit every variant to its training sets; return `evaluate`(model, training set) of each; results must pickle."""
    batches = [(v, indices) for v, sets in training_sets.items() for indices in _batches(cfg, v, sets)]
    jobs = [(v, [training_sets[v][i] for i in indices]) for v, indices in batches]
    results: dict[str, dict[int, Answer]] = {v: {} for v in training_sets}
    fitted = map_jobs(partial(_fit, cfg, evaluate), jobs, cfg.workers, desc)
    for (v, indices), answers in zip(batches, fitted, strict=True):
        results[v] |= zip(indices, answers, strict=True)
    return {v: [by_index[i] for i in range(len(by_index))] for v, by_index in results.items()}


def _batches(cfg: DictConfig, variant: str, training_sets: Sequence[TrainingSet]) -> list[list[int]]:
    """Return batches of training sets, by index: neighbours of equally many scenes, which may share images."""
    batch_size = LANES if cfg.variants[variant].stage == "train" else len(cfg.protocol.seeds)
    by_scenes: dict[int, list[int]] = {}
    for i, training_set in enumerate(training_sets):
        by_scenes.setdefault(len(training_set.images), []).append(i)
    return [group[i : i + batch_size] for group in by_scenes.values() for i in range(0, len(group), batch_size)]


def _fit(
    cfg: DictConfig, evaluate: Callable[[ValidityModel, TrainingSet], Answer], job: tuple[str, Sequence[TrainingSet]]
) -> list[Answer]:
    """Fit one batch of models of a variant, seeded as in the variant's own stage, and evaluate them."""
    variant, training_sets = job
    kind, fit = trainer(cfg, variant)
    seeds = [job_seed(t.seed, t.user, cfg.main_n_demos, variant) for t in training_sets]
    models = [untrained(kind, cfg.variants[variant].model, seed) for seed in seeds]
    images, z_theta, valid = ([getattr(t, name) for t in training_sets] for name in ("images", "z_theta", "valid"))
    curves = fit(models, images, z_theta, valid, seeds=seeds)
    for training_set, curve in zip(training_sets, curves, strict=True):
        need_finite(curve, f"{variant} of {training_set.user}, seed {training_set.seed}")
    return [evaluate(model, training_set) for model, training_set in zip(models, training_sets, strict=True)]


def trainer(cfg: DictConfig, variant: str) -> tuple[type[ValidityModel], Fit]:
    """Return the model class and the fit function of a variant's own stage (train, irl or clearance)."""
    v = cfg.variants[variant]
    if v.stage == "train":
        weights = Weights(float(v.alpha), float(v.beta), float(v.gamma))
        return BetaVae, partial(fit_stack, weights=weights, schedule=Schedule.of(cfg.train))
    if v.stage == "irl":
        schedule = irl.IrlSchedule.of({**cfg.irl, "steps": v.steps})
        return RewardMap, partial(fit_sequentially, irl.fit, objective=v.objective, schedule=schedule)
    return ClearanceModel, partial(clearance.fit, schedule=Schedule.of(cfg.clearance))
