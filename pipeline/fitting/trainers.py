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

from pipeline.fitting.grid import Fit, need_finite, one_by_one
from pipeline.parallel import map_jobs
from pipeline.spec import clearance, irl
from pipeline.spec.descent import Schedule
from pipeline.spec.losses import Weights
from pipeline.spec.reward import RewardMap
from pipeline.spec.specification import Specification, untrained
from pipeline.spec.stacked import LANES, fit_stack
from pipeline.spec.vae import VaeSpecification
from pipeline.streams import job_seed

Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Lesson:
    """What one model is fitted to: a user's demonstrations in a seed's scenes."""

    user: str
    seed: int
    images: UInt8[Array, "scene 100 100 3"]
    z_theta: Float[Array, "scene n 2"]  # [m]
    valid: Bool[Array, "scene n"]


def fit_and_ask(
    cfg: DictConfig,
    lessons: Mapping[str, Sequence[Lesson]],
    images: UInt8[Array, "picture 100 100 3"],
    z_theta: Float[Array, "picture path 2"],
    desc: str,
) -> dict[str, Float32[Array, "lesson picture path"]]:
    """Fit every variant's models; P(valid) of every path [m] in its picture by each of them."""
    answers = fit_each(cfg, lessons, partial(_answer, images, z_theta), desc)
    return {variant: np.stack(of) for variant, of in answers.items()}


def _answer(images: Array, z_theta: Array, model: Specification, _: Lesson) -> Float32[Array, "picture path"]:
    return model.probability(images, z_theta)


def fit_each(
    cfg: DictConfig,
    lessons: Mapping[str, Sequence[Lesson]],
    answer: Callable[[Specification, Lesson], Answer],
    desc: str,
) -> dict[str, list[Answer]]:
    """Fit every variant's models; what `answer`, which must pickle, makes of each one and its lesson."""
    batches = [(v, at) for v, of in lessons.items() for at in _batches(cfg, v, of)]
    taught = [(v, [lessons[v][i] for i in at]) for v, at in batches]
    answers: dict[str, dict[int, Answer]] = {v: {} for v in lessons}
    for (v, at), found in zip(batches, map_jobs(partial(_fit, cfg, answer), taught, cfg.workers, desc), strict=True):
        answers[v] |= zip(at, found, strict=True)
    return {v: [by_lesson[i] for i in range(len(by_lesson))] for v, by_lesson in answers.items()}


def _batches(cfg: DictConfig, variant: str, lessons: Sequence[Lesson]) -> list[list[int]]:
    """Which lessons are fitted together: as many scenes in each, side by side (IRL draws a picture's looks once)."""
    at_once = LANES if cfg.variants[variant].stage == "train" else len(cfg.protocol.seeds)
    alike: dict[int, list[int]] = {}
    for i, lesson in enumerate(lessons):
        alike.setdefault(len(lesson.images), []).append(i)
    return [at[i : i + at_once] for at in alike.values() for i in range(0, len(at), at_once)]


def _fit(
    cfg: DictConfig, answer: Callable[[Specification, Lesson], Answer], batch: tuple[str, Sequence[Lesson]]
) -> list[Answer]:
    """Fit one batch of models of a variant, each begun as its own stage begins it, and ask them."""
    variant, lessons = batch
    kind, fit = _trainer(cfg, variant)
    seeds = [job_seed(lesson.seed, lesson.user, cfg.study_n, variant) for lesson in lessons]
    models = [untrained(kind, cfg.variants[variant].model, seed) for seed in seeds]
    taught = [(lesson.images, lesson.z_theta, lesson.valid) for lesson in lessons]
    curves = fit(models, *map(list, zip(*taught, strict=True)), seeds=seeds)
    for lesson, curve in zip(lessons, curves, strict=True):
        need_finite(curve, f"{variant} of {lesson.user}, seed {lesson.seed}")
    return [answer(model, lesson) for model, lesson in zip(models, lessons, strict=True)]


def _trainer(cfg: DictConfig, variant: str) -> tuple[type[Specification], Fit]:
    """What a variant's own stage (train, irl or path) fits, and how."""
    v = cfg.variants[variant]
    if v.stage == "train":
        weights = Weights(float(v.alpha), float(v.beta), float(v.gamma))
        return VaeSpecification, partial(fit_stack, weights=weights, schedule=Schedule.of(cfg.train))
    if v.stage == "irl":
        pace = irl.Schedule.of({**cfg.irl, "steps": v.steps})
        return RewardMap, partial(one_by_one, irl.fit, objective=v.objective, schedule=pace)
    return clearance.ClearanceModel, partial(clearance.fit, schedule=Schedule.of(cfg.path))
