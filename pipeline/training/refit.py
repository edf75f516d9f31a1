"""Models fitted by stages that only want their answers: as their own stage fits them, to other demonstrations.

VAEs are fitted by the stacked engine, whatever `train.engine` is.
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
from pipeline.training.loop import Schedule
from pipeline.training.runner import Fit, fit_sequentially, need_finite
from pipeline.training.vae.engines.simd import LANES, fit_stack

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class TrainingSet:
    """What one model is fitted to: a user's demonstrations in a seed's scenes."""

    user: str
    seed: int
    images: UInt8[Array, "scene 100 100 3"]
    z_theta: Float[Array, "scene n 2"]  # [m]
    valid: Bool[Array, "scene n"]


def refit_and_predict(
    cfg: DictConfig,
    training_sets: Mapping[str, Sequence[TrainingSet]],
    images: UInt8[Array, "picture 100 100 3"],
    z_theta: Float[Array, "picture path 2"],
    desc: str,
) -> dict[str, Float32[Array, "training_set picture path"]]:
    """Fit every variant's models; P(valid) of every path [m] in its picture by each of them."""
    answers = refit(cfg, training_sets, partial(_answer, images, z_theta), desc)
    return {variant: np.stack(of) for variant, of in answers.items()}


def _answer(images: Array, z_theta: Array, model: ValidityModel, _: TrainingSet) -> Float32[Array, "picture path"]:
    return model.probability(images, z_theta)


def refit(
    cfg: DictConfig,
    training_sets: Mapping[str, Sequence[TrainingSet]],
    answer: Callable[[ValidityModel, TrainingSet], Answer],
    desc: str,
) -> dict[str, list[Answer]]:
    """Fit every variant's models; what `answer`, which must pickle, makes of each one and its training_set."""
    batches = [(v, at) for v, of in training_sets.items() for at in _batches(cfg, v, of)]
    taught = [(v, [training_sets[v][i] for i in at]) for v, at in batches]
    answers: dict[str, dict[int, Answer]] = {v: {} for v in training_sets}
    for (v, at), found in zip(batches, map_jobs(partial(_fit, cfg, answer), taught, cfg.workers, desc), strict=True):
        answers[v] |= zip(at, found, strict=True)
    return {v: [by_lesson[i] for i in range(len(by_lesson))] for v, by_lesson in answers.items()}


def _batches(cfg: DictConfig, variant: str, training_sets: Sequence[TrainingSet]) -> list[list[int]]:
    """Which training_sets are fitted together: as many scenes in each, side by side (IRL draws a picture's looks once)."""
    batch_size = LANES if cfg.variants[variant].stage == "train" else len(cfg.protocol.seeds)
    alike: dict[int, list[int]] = {}
    for i, training_set in enumerate(training_sets):
        alike.setdefault(len(training_set.images), []).append(i)
    return [at[i : i + batch_size] for at in alike.values() for i in range(0, len(at), batch_size)]


def _fit(
    cfg: DictConfig, answer: Callable[[ValidityModel, TrainingSet], Answer], batch: tuple[str, Sequence[TrainingSet]]
) -> list[Answer]:
    """Fit one batch of models of a variant, each begun as its own stage begins it, and ask them."""
    variant, training_sets = batch
    kind, fit = _trainer(cfg, variant)
    seeds = [
        job_seed(training_set.seed, training_set.user, cfg.main_n_demos, variant) for training_set in training_sets
    ]
    models = [untrained(kind, cfg.variants[variant].model, seed) for seed in seeds]
    taught = [(training_set.images, training_set.z_theta, training_set.valid) for training_set in training_sets]
    curves = fit(models, *map(list, zip(*taught, strict=True)), seeds=seeds)
    for training_set, curve in zip(training_sets, curves, strict=True):
        need_finite(curve, f"{variant} of {training_set.user}, seed {training_set.seed}")
    return [answer(model, training_set) for model, training_set in zip(models, training_sets, strict=True)]


def _trainer(cfg: DictConfig, variant: str) -> tuple[type[ValidityModel], Fit]:
    """What a variant's own stage (train, irl or path) fits, and how."""
    v = cfg.variants[variant]
    if v.stage == "train":
        weights = Weights(float(v.alpha), float(v.beta), float(v.gamma))
        return BetaVae, partial(fit_stack, weights=weights, schedule=Schedule.of(cfg.train))
    if v.stage == "irl":
        pace = irl.IrlSchedule.of({**cfg.irl, "steps": v.steps})
        return RewardMap, partial(fit_sequentially, irl.fit, objective=v.objective, schedule=pace)
    return ClearanceModel, partial(clearance.fit, schedule=Schedule.of(cfg.clearance))
