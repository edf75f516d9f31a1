"""Stage safety: the distance each user keeps from each symbol, and a bound on the invalid paths that are accepted.

Envelopes (pipeline.causal.envelope): every variant's distances beside the true margins, from the same paths in scenes
without and with an added item. Acceptance: conformal selection fits each model to part of its seed's training scenes
and calibrates it in the others; the fixed threshold, P(valid) > 1/2, uses a model fitted to all of them. All query
paths of a split are the candidates of one selection; a model that accepts none has an invalid share of 0.
"""

from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import read_queries
from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import AddedItems, read_interventions, read_position_prior, read_scenes, train_pool
from pipeline.causal.envelope import dose_grid, envelopes, path_at_doses, response_curve
from pipeline.launch import launch
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import POSITION, position_only
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime import settings
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Between, Count, Group, Length, Several, Shares, Some, StudyGroup, Whole, need
from pipeline.runtime.streams import stream
from pipeline.stats.conformal import accept, p_values, score, share_by_scene
from pipeline.stats.crossed import Items, estimate, items_held
from pipeline.stats.scores import DECISION
from pipeline.training.judged_sets import NEW_ITEMS
from pipeline.training.refit import TrainingSet, demonstrations, refit
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import clearance, valid

TRUTH, ALL = "truth", "all"  # beside variants and users in tables
CONFORMAL, THRESHOLD = "conformal", "threshold"  # how paths are accepted
KEY = ["variant", "split", "rule", "user"]  # of outcomes
TOLERANCE = 1e-12  # numerical tolerance when a share is compared with the level


class Envelope(Group):
    """Doses, random paths, and the variant whose distances the page shows."""

    planner: str
    step: Length
    doses: Several
    clear_of_others: Length
    candidates: Count
    root_seed: Whole


class Acceptance(Group):
    """Promised shares of invalid paths, and the variants that are refitted."""

    variants: Some
    level: Between
    levels: Shares
    fitted: Count
    root_seed: Whole


class Settings(StudyGroup):
    envelope: Envelope
    acceptance: Acceptance


def agree(study: Settings, parameters: Any) -> None:
    """Require known variants, paths beyond every margin, `level` among `levels`, and scenes left for calibration."""
    envelope, promise, name = study.envelope, study.acceptance, "studies.safety"
    settings.need_one(f"{name}.envelope.planner", envelope.planner, parameters.variants)
    settings.need_some(f"{name}.acceptance.variants", promise.variants, parameters.variants)
    widest, per_seed = settings.widest_margin(parameters.users) or 0.0, parameters.scenes.per_seed
    above = f"more than the widest margin in users, {widest} m"
    need(envelope.clear_of_others > widest, f"{name}.envelope.clear_of_others", envelope.clear_of_others, above)
    among = f"{name}.acceptance.level = {promise.level} among them"
    need(promise.level in promise.levels, f"{name}.acceptance.levels", promise.levels, among)
    most = f"a whole number from 1 to scenes.per_seed - 1 = {per_seed - 1}"
    need(promise.fitted < per_seed, f"{name}.acceptance.fitted", promise.fitted, most)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write the distances that models learned, then how many invalid paths are accepted."""
    check_weights(cfg)
    write_envelopes(cfg, out_dir)
    write_acceptance(cfg, out_dir)


# Envelopes


@dataclass(frozen=True)
class Scenes:
    """The scenes without and with each added symbol, and random paths in them."""

    images: UInt8[Array, "scene 100 100 3"]
    layouts: Layouts
    added: AddedItems
    z_theta: Float[Array, "scene candidate 2"]  # [m]
    n_training: list[int]  # number of items of each symbol in the training scenes of all seeds


Chosen = Int[Array, "symbol scene dose"]  # candidates; -1: none


def write_envelopes(cfg: DictConfig, out_dir: Path) -> None:
    """Write envelope.csv and response.parquet."""
    study, users, scenes = cfg.studies.safety.envelope, list(cfg.users), read_envelope_scenes(cfg)
    doses = dose_grid(study.step, study.doses)
    by_variant = responses(cfg, scenes, choose_paths(cfg, scenes, doses))

    questions = list(product(users, SYMBOLS))
    names = pd.DataFrame([("", *question) for question in questions], columns=["variant", "user", "symbol"])
    margins = [cfg.users[user][symbol] for user, symbol in questions]
    item = np.tile(scenes.added.item, (len(users), 1))  # (question, scene)
    tables, curves = [], []
    for variant, response in by_variant.items():
        values = response.reshape(len(questions), *response.shape[2:])
        n_training = [None] * len(questions) if variant == TRUTH else scenes.n_training * len(users)
        table = envelopes(values, item, n_training, margins, doses)
        tables.append(pd.concat([names.assign(variant=variant), table], axis=1))
        for q, (user, symbol) in enumerate(questions):
            curve = response_curve(values[q], item[q], n_training[q], doses)
            curves.append(curve.assign(variant=variant, user=user, symbol=symbol))
    write_table(out_dir / "envelope.csv", pd.concat(tables, ignore_index=True))
    write_table(out_dir / "response.parquet", pd.concat(curves, ignore_index=True))


def read_envelope_scenes(cfg: DictConfig) -> Scenes:
    """Read the scenes without and with added items, and draw the candidate paths."""
    study, pool = cfg.studies.safety.envelope, cfg.protocol.splits[cfg.intervene.split]
    scenes = read_scenes(Path(cfg.paths.scenes))
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    images, layouts = scenes.images[pool], scenes.layouts[pool]
    added = read_interventions(Path(cfg.paths.intervene), layouts)
    z_theta = random_z_theta(stream(study.root_seed, "envelope"), len(layouts), study.candidates)
    training = [scenes.layouts[train_pool(seed)] for seed in cfg.protocol.seeds]
    shown = [set(np.concatenate([x.item[x.symbol == s] for x in training])) for s in range(len(SYMBOLS))]
    return Scenes(images, layouts, added, z_theta, [max(1, len(items)) for items in shown])


def choose_paths(cfg: DictConfig, scenes: Scenes, doses: Float[Array, " dose"]) -> Chosen:
    """Return a candidate at each dose; InputError if a dose occurs with fewer than two items of a symbol."""
    study = cfg.studies.safety.envelope
    to_others = clearance(scenes.layouts, scenes.z_theta).min(-1)
    to_added = [clearance(item, scenes.z_theta)[..., 0] for item in scenes.added.placed]
    chosen = np.stack([path_at_doses(c, to_others, doses, study.clear_of_others) for c in to_added])
    for symbol, item, has_dose in zip(SYMBOLS, scenes.added.item, chosen >= 0, strict=True):
        items = np.array([len(np.unique(item[scene])) for scene in has_dose.T])  # number of items by dose
        if items.min() < 2:
            what = f"{items.min()} items have a path {doses[items.argmin()]:.4f} m from an added {symbol}"
            how = "raise studies.safety.envelope.candidates, lower its doses or clear_of_others, or intervene on"
            raise InputError(f"{what} and in contact, in some scene: expected at least 2; {how} more scenes")
    return chosen


def responses(cfg: DictConfig, scenes: Scenes, chosen: Chosen) -> dict[str, Array]:
    """Return each variant's loss of P(valid), (user, symbol, seed, scene, dose), and the truth's as of one seed.

    Paths are the same without and with the item. Each original scene is perceived once, with those of all symbols.
    """
    users = list(cfg.users)
    z_theta = np.take_along_axis(scenes.z_theta[None], chosen[..., None], axis=2)  # (symbol, scene, dose, 2)
    has_dose = np.nonzero(chosen[:, :, 0] >= 0)  # symbols and scenes with a path in contact, hence with any
    before = predict_all(cfg, users, scenes.images, np.concatenate(z_theta, axis=1), "envelope: as it is")
    after = predict_all(cfg, users, scenes.added.images[has_dose], z_theta[has_dose], "envelope: added item")
    by_variant = {}
    for variant in cfg.variants:
        p = before[variant].reshape(*before[variant].shape[:3], len(SYMBOLS), -1)  # (user, seed, scene, symbol, path)
        p_before = np.moveaxis(p, 3, 2)
        p_after = np.full_like(p_before, np.nan)
        p_after[:, :, *has_dose] = after[variant]
        loss = np.where(chosen >= 0, (p_before - p_after).astype(np.float64), np.nan)
        by_variant[variant] = np.moveaxis(loss, 2, 1)

    margins, added = cfg.users.values(), list(zip(scenes.added.layouts, z_theta, strict=True))
    without = np.array([[valid(scenes.layouts, z, m) for z in z_theta] for m in margins], float)
    with_item = np.array([[valid(layouts, z, m) for layouts, z in added] for m in margins], float)
    return by_variant | {TRUTH: np.where(chosen >= 0, without - with_item, np.nan)[:, :, None]}


# Acceptance


def write_acceptance(cfg: DictConfig, out_dir: Path) -> None:
    """Write levels.csv, outcomes at each promised share, and acceptance.csv, those at the promise by user."""
    study, users, seeds = cfg.studies.safety.acceptance, list(cfg.evaluate.users), list(cfg.protocol.seeds)
    scenes = read_scenes(Path(cfg.paths.scenes))
    splits = {split: pool for split, pool in cfg.protocol.splits.items() if pool}
    scenes.check_has(*map(train_pool, seeds), *splits.values())
    complete = demonstrations(cfg, scenes)
    queries = {split: read_queries(Path(cfg.paths.demos))[pool] for split, pool in splits.items()}
    images = np.concatenate([scenes.images[pool] for pool in splits.values()])
    z_theta = np.concatenate([q.z for q in queries.values()])

    # Two models per user and seed: one of some scenes, for conformal selection, and one of all, for the threshold.
    draws = [stream(study.root_seed, "scenes", x.seed).permutation(len(x.images)) for x in complete]  # same for users
    fitted = [np.sort(drawn[: study.fitted]) for drawn in draws]
    parts = zip(complete, fitted, strict=True)
    some = [replace(x, images=x.images[i], z_theta=x.z_theta[i], valid=x.valid[i]) for x, i in parts]
    demos = {(x.user, x.seed): x for x in complete}

    def predict(model: ValidityModel, fitted_to: TrainingSet) -> tuple[Array, Array]:
        shown = demos[fitted_to.user, fitted_to.seed]
        return model.probability(shown.images, shown.z_theta), model.probability(images, z_theta)

    answers = refit(cfg, dict.fromkeys(study.variants, some + complete), predict, "accept")
    prior = read_position_prior(Path(cfg.paths.scenes))
    blind = [(position_only(prior[x.user], x.z_theta), position_only(prior[x.user], z_theta)) for x in complete]
    answers[POSITION] = 2 * blind  # fitted to no demonstrations

    at_levels, by_user, levels = {}, {}, list(study.levels)
    for variant, predictions in answers.items():
        of_some, of_all = predictions[: len(complete)], predictions[len(complete) :]
        end = 0
        for split, q in queries.items():
            paths, layouts = slice(end, end := end + len(q.z)), scenes.layouts[splits[split]]
            conformal = []  # calibrated in the training scenes that were not fitted
            for x, part, (p_demos, p_paths) in zip(complete, fitted, of_some, strict=True):
                held_out = np.setdiff1d(np.arange(len(p_demos)), part)
                labels, candidates = x.valid[held_out].ravel(), score(p_paths[paths].ravel())
                p = p_values(score(p_demos[held_out].ravel()), labels, candidates)
                conformal.append([accept(p, level) for level in levels])
            threshold = [[p_paths[paths] > DECISION] * len(levels) for _, p_paths in of_all]
            truth = np.stack([q.valid[user] for user in users])
            items = items_held(layouts.item, layouts.symbol) if split == NEW_ITEMS else None
            for rule, accepted in ((CONFORMAL, conformal), (THRESHOLD, threshold)):
                choices = np.reshape(accepted, (len(users), len(seeds), len(levels), *q.z.shape[:2]))
                at_levels[variant, split, rule] = outcomes(choices, truth, levels, items)
                promised = choices[:, :, [levels.index(study.level)]]
                for user, chosen in [(ALL, slice(None)), *((user, [i]) for i, user in enumerate(users))]:
                    promise = outcomes(promised[chosen], truth[chosen], [study.level], items)
                    by_user[variant, split, rule, user] = promise
    table = pd.concat(at_levels, names=KEY[:3]).reset_index(KEY[:3])
    table["abstained"] /= table["models"]
    write_table(out_dir / "levels.csv", table.drop(columns=["power", "above", "models"]))
    table = pd.concat(by_user, names=KEY).reset_index(KEY)
    write_table(out_dir / "acceptance.csv", table.drop(columns="level"))


def outcomes(
    accepted: Bool[Array, "user seed level scene path"],
    valid: Bool[Array, "user scene path"],
    levels: list[float],
    items: Items,
) -> pd.DataFrame:
    """Return what came of the paths that some users' models accept, a row for each promised level.

    invalid: share of invalid paths among the accepted ones, with its 95 % interval over seeds and scenes, and over
    the `items` (scene, item) of all scenes if they are chance; power: share of valid paths that are accepted; above:
    number of models whose share of invalid paths exceeds the level; abstained: number of models that accept none.
    """
    truth = np.broadcast_to(valid[:, None, None], accepted.shape)
    count, correct = accepted.sum(-1), (accepted & truth).sum(-1)  # (user, seed, level, scene)
    invalid, power = share_by_scene(count - correct, count), share_by_scene(correct, truth.sum(-1))
    e = estimate(np.moveaxis(invalid.mean(0), 1, 0), items=items)  # (level, seed, scene)
    shares = {"invalid": e.effect, "ci_low": e.ci_low.clip(0, 1), "ci_high": e.ci_high.clip(0, 1)}
    above = (invalid.mean(-1) > np.array(levels) + TOLERANCE).sum((0, 1))
    numbers = {"above": above, "abstained": (count.sum(-1) == 0).sum((0, 1)), "models": count[..., 0, 0].size}
    return pd.DataFrame({"level": levels} | shares | {"power": power.mean((0, 1, 3))} | numbers)


if __name__ == "__main__":
    launch(main, "safety")
