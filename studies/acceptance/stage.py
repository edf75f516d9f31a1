"""Stage accept: which paths a model may accept so that at most a promised share is invalid, and does that come true?

All new paths of a split are the candidates of one choice. A model that accepts none of them counts as one without
error: the false discovery rate is an expectation over all models; nothing is promised of those alone that accept some
(`where_any`).
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Float32, Int
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import write_json, write_table
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.causal.interventions import DIGITS
from pipeline.launch import launch
from pipeline.models.base import ValidityModel
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.conformal import (
    Calibration,
    accept,
    accept_knowing,
    by_scene,
    fewest_demonstrations,
    fewest_without_error,
    p_values,
    score,
)  # fmt: skip
from pipeline.stats.crossed import Estimates, estimate
from pipeline.stats.scores import DECISION
from pipeline.training.refit import TrainingSet, refit

SPLIT, CROSSED, TRAINING = "split", "crossed", "training"  # how held-out scores come about; TRAINING: they do not
RULES = (SPLIT, CROSSED, TRAINING, "decision", "truth")
Who = tuple[str, int]  # user, seed


class Part(NamedTuple):
    """The training scenes that a model is fitted to, and those whose demonstrations calibrate it."""

    fitted: Int[Array, " scene"]
    calibrating: Int[Array, " scene"]


Parts = dict[str, list[Part]]  # by form


class Scores(NamedTuple):
    """P(valid) by one model of all its seed's demonstrations, and of every split's paths, one after the other."""

    demonstrations: Float32[Array, "scene n"]
    paths: Float32[Array, "picture path"]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json, and curve.csv: the same for every promise."""
    scenes, pools = read_scenes(Path(cfg.paths.scenes)), _pools(cfg)
    _check_scenes(cfg, scenes)
    demos, queries = read_demos(Path(cfg.paths.demos)), read_queries(Path(cfg.paths.demos))
    users, seeds = list(cfg.evaluate.users), list(cfg.protocol.seeds)
    whole = {(user, seed): _whole(cfg, scenes, demos, user, seed) for user in users for seed in seeds}
    images = np.concatenate([scenes.images[pool] for pool in pools.values()])
    z_theta = np.concatenate([queries[pool].z for pool in pools.values()])
    parts = {seed: _parts(cfg, seed) for seed in seeds}
    scores = _scores(cfg, parts, whole, images, z_theta)
    found, first = {}, 0
    for split, pool in pools.items():
        here = slice(first, first := first + len(queries[pool].z))
        truth = np.stack([queries[pool].valid[user] for user in users])
        for variant in cfg.accept.variants:
            accepted = _accepted(cfg, parts, whole, scores[variant], here, truth)
            found[variant, split] = {rule: _outcome(a, truth) for rule, a in accepted.items()}
    curves = [_curve(cfg, variant, split, by_rule) for (variant, split), by_rule in found.items()]
    write_table(out_dir / "curve.csv", pd.concat(curves))
    write_json(out_dir / "metrics.json", _metrics(cfg, found, whole, truth.shape[1:]))


def _check_scenes(cfg: DictConfig, scenes: SceneSet) -> None:
    """Raise InputError if a pool is missing, or a seed's training scenes are not as many as `scenes.per_seed`."""
    scenes.check_has(*map(train_pool, cfg.protocol.seeds), *_pools(cfg).values())
    for pool in map(train_pool, cfg.protocol.seeds):
        if len(scenes.images[pool]) != cfg.scenes.per_seed:
            raise InputError(
                f"{len(scenes.images[pool])} scenes {pool}: expected {cfg.scenes.per_seed}; run the scenes stage again"
            )


def _whole(cfg: DictConfig, scenes: SceneSet, demos: pd.DataFrame, user: str, seed: int) -> TrainingSet:
    """All that a user demonstrated in a seed's scenes."""
    z_theta, valid = demo_arrays(demos, seed, user, cfg.main_n_demos)
    return TrainingSet(user, seed, scenes.images[train_pool(seed)], z_theta, valid)


def _pools(cfg: DictConfig) -> dict[str, str]:
    """The splits that all seeds share, and their pools."""
    return {split: pool for split, pool in cfg.protocol.splits.items() if pool}


def _parts(cfg: DictConfig, seed: int) -> Parts:
    """Which of a seed's scenes each model of a form is fitted to; the same for every user and variant."""
    everything = np.arange(cfg.scenes.per_seed)
    order = stream(cfg.accept.root_seed, "scenes", seed).permutation(everything)
    fitted, rest = np.split(order, [cfg.accept.fitted])
    folds = np.split(order, cfg.accept.folds)
    return {
        SPLIT: [Part(np.sort(fitted), rest)],
        CROSSED: [Part(np.setdiff1d(everything, fold), fold) for fold in folds],
        TRAINING: [Part(everything, everything)],
    }


def _scores(
    cfg: DictConfig,
    parts: Mapping[int, Parts],
    whole: Mapping[Who, TrainingSet],
    images: Array,
    z_theta: Array,
) -> dict[str, dict[tuple[str, Who], list[Scores]]]:
    """variant -> (form, (user, seed)) -> the scores by each part's model."""
    forms = [(form, who) for who in whole for form in parts[who[1]]]
    training_sets = [_lesson(whole[who], part) for form, who in forms for part in parts[who[1]][form]]
    answer = partial(_ask, whole, images, z_theta)
    answers = refit(cfg, dict.fromkeys(cfg.accept.variants, training_sets), answer, "accept")
    rest = {variant: iter(scores) for variant, scores in answers.items()}
    return {v: {(form, who): [next(of) for _ in parts[who[1]][form]] for form, who in forms} for v, of in rest.items()}


def _lesson(own: TrainingSet, part: Part) -> TrainingSet:
    at = part.fitted
    return TrainingSet(own.user, own.seed, own.images[at], own.z_theta[at], own.valid[at])


def _ask(
    whole: Mapping[Who, TrainingSet], images: Array, z_theta: Array, model: ValidityModel, training_set: TrainingSet
) -> Scores:
    own = whole[training_set.user, training_set.seed]
    return Scores(model.probability(own.images, own.z_theta), model.probability(images, z_theta))


def _accepted(
    cfg: DictConfig,
    parts: Mapping[int, Parts],
    whole: Mapping[Who, TrainingSet],
    scores: Mapping[tuple[str, Who], list[Scores]],
    here: slice,
    truth: Bool[Array, "user scene path"],
) -> dict[str, Bool[Array, "level user seed scene path"]]:
    """rule -> the paths of one split that it accepts for each promise."""
    levels, shape = list(cfg.accept.levels), truth.shape[1:]
    accepted: dict[str, list] = {rule: [] for rule in RULES}
    for (user, seed), own in whole.items():
        for form in (SPLIT, CROSSED, TRAINING):
            calibrations = [
                Calibration(score(s.demonstrations[at].ravel()), own.valid[at].ravel(), score(s.paths[here].ravel()))
                for s, (_, at) in zip(scores[form, (user, seed)], parts[seed][form], strict=True)
            ]
            p = p_values(calibrations)
            accepted[form].append([accept(p, level) for level in levels])
        p, valid = scores[TRAINING, (user, seed)][0].paths[here].ravel(), truth[list(cfg.evaluate.users).index(user)]
        accepted["decision"].append([p > DECISION] * len(levels))
        accepted["truth"].append([accept_knowing(p, valid.ravel(), level) for level in levels])
    return {
        rule: np.moveaxis(np.reshape(of, (len(truth), -1, len(levels), *shape)), 2, 0) for rule, of in accepted.items()
    }


class Outcome(NamedTuple):
    """What a rule's choices are worth; every field (level, user, seed, scene), see `by_scene` for the shares."""

    false: Float[Array, "level user seed scene"]  # share of invalid paths among the accepted ones
    power: Float[Array, "level user seed scene"]  # share of valid paths that are accepted
    count: Int[Array, "level user seed scene"]  # accepted paths


def _outcome(accepted: Bool[Array, "level user seed scene path"], truth: Bool[Array, "user scene path"]) -> Outcome:
    valid = np.broadcast_to(truth[:, None], accepted.shape)
    count = accepted.sum(-1)
    right = (accepted & valid).sum(-1)
    return Outcome(by_scene(count - right, count), by_scene(right, valid.sum(-1)), count)


def _curve(cfg: DictConfig, variant: str, split: str, found: Mapping[str, Outcome]) -> pd.DataFrame:
    """Rows of every rule and promise: mean over users, with 95 % intervals over seeds and scenes."""
    rows = []
    for rule, outcome in found.items():
        false, power = estimate(outcome.false.mean(1)), estimate(outcome.power.mean(1))
        abstained = (outcome.count.sum(-1) == 0).mean((1, 2))
        columns = {"variant": variant, "split": split, "rule": rule, "level": list(cfg.accept.levels)}
        columns |= _limits("false", false) | _limits("power", power) | {"abstained": abstained}
        rows.append(pd.DataFrame(columns))
    return pd.concat(rows).round(DIGITS)


def _limits(name: str, e: Estimates) -> dict[str, Array]:
    """A share's mean and its interval, which ends where shares do."""
    return {name: e.effect, f"{name}_low": np.clip(e.ci_low, 0, 1), f"{name}_high": np.clip(e.ci_high, 0, 1)}


def _metrics(
    cfg: DictConfig,
    found: Mapping[tuple[str, str], Mapping[str, Outcome]],
    whole: Mapping[Who, TrainingSet],
    shape: tuple[int, ...],
) -> dict:
    """variant -> split -> rule -> numbers at the promise, over all users and by user; what a promise needs."""
    c, at = cfg.accept, list(cfg.accept.levels).index(cfg.accept.level)
    users, (scenes, paths) = list(cfg.evaluate.users), shape
    acceptance: dict = {}
    for (variant, split), by_rule in found.items():
        cells = acceptance.setdefault(variant, {})[split] = {}
        for rule, outcome in by_rule.items():
            false, power, count = (values[at] for values in outcome)
            by_user = [_cell(c.level, false[i], power[i], count[i]) for i in range(len(users))]
            cells[rule] = _cell(c.level, false, power, count) | {"users": dict(zip(users, by_user, strict=True))}
    labels = cfg.scenes.per_seed * cfg.main_n_demos
    held_out = {SPLIT: (cfg.scenes.per_seed - c.fitted) * cfg.main_n_demos, CROSSED: labels}
    shares = {
        user: float(np.mean([own.valid.mean() for (of, _), own in whole.items() if of == user])) for user in users
    }
    return {
        "acceptance": acceptance,
        "rules": list(RULES),
        "level": c.level,
        "error": c.error,
        "labels": labels,
        "held_out": held_out,
        "valid": {user: round(share, DIGITS) for user, share in shares.items()},
        "fewest": {user: fewest_demonstrations(c.level, share) for user, share in shares.items() if share > 0},
        "without_error": fewest_without_error(c.level, c.error),
        "seeds": len(cfg.protocol.seeds),
        "scenes": scenes,
        "paths": paths,
    }


def _cell(level: float, false: Array, power: Array, count: Array) -> dict:
    """Numbers of one rule from (..., seed, scene): shares, their spread over models, and how many break the promise."""
    by_model = false.mean(-1)
    e = estimate(false.reshape(-1, *false.shape[-2:]).mean(0)[None])
    spread = dict(zip(("q1", "q3"), np.quantile(by_model, (0.25, 0.75)), strict=True))
    shares = {"mean": e.effect[0], "ci_low": max(e.ci_low[0], 0.0), "ci_high": min(e.ci_high[0], 1.0), **spread}
    shares |= {"power": power.mean(), "accepted": count.sum(-1).mean()}
    some = count.sum(-1) > 0
    return {name: round(float(value), DIGITS) for name, value in shares.items()} | {
        "where_any": round(float(by_model[some].mean()), DIGITS) if some.any() else None,
        "above": int((by_model > level + 1e-12).sum()),
        "abstained": int((~some).sum()),
        "models": by_model.size,
    }


if __name__ == "__main__":
    launch(main, "accept")
