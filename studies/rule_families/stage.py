"""Stage rule_families: fit models to users whose rules belong to another family, and evaluate them by that family.

In addition to the variants we fit the clearance model of family `margin` alone, without averaging over families
(pipeline.models.clearance.clearance).
"""

from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, read_interventions, read_scenes, train_pool
from pipeline.causal.added_items import verdicts
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.base import ValidityModel
from pipeline.models.baselines import POSITION
from pipeline.models.clearance.clearance import FAMILIES as FAMILIES_OF_MODEL
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.stats.decisions import accuracy_by_seed, accuracy_estimate, accuracy_loss
from pipeline.stats.scores import DECISION
from pipeline.training.refit import TrainingSet, refit
from pipeline.world.bezier import lattice
from pipeline.world.layout import Layouts
from studies.rule_families.families import FAMILIES, OWN_FAMILY

AVERAGED, MARGIN_ALONE = "clearance", "clearance_margin"  # the clearance model, and the same of one family
FITTED_FAMILIES = [*FAMILIES_OF_MODEL, "constant"]  # in the order of its posterior probabilities


class Fitted(NamedTuple):
    """Predictions of one fitted model."""

    p: Float[Array, "image path"]
    training_accuracy: float
    posterior: Float[Array, " fitted_family"] | None  # only of AVERAGED


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write accuracy.parquet, summary.csv, verdicts.csv and posterior.csv."""
    study, users, seeds = cfg.studies.rule_families, list(cfg.evaluate.users), list(cfg.protocol.seeds)
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool, *map(train_pool, seeds))
    added = read_interventions(Path(cfg.paths.intervene), scenes.layouts[pool])
    first = slice(study.scenes)
    z_theta = read_arrays(Path(cfg.paths.intervene) / "images.npz")["z_theta"][first]
    layouts = [x[first] for x in (scenes.layouts[pool], *added.layouts)]  # by version: original, each symbol added
    images = np.concatenate([scenes.images[pool][None, first], added.images[:, first]])  # (version, scene, ...)

    fitted = fit_all(cfg, scenes, images, z_theta)
    accuracies, summary, judged, posteriors = [], [], [], []
    before: dict[str, tuple[Array, Array]] = {}  # variant -> accepted and valid in the users' own family
    for family in [OWN_FAMILY, *(x for x in study.families if x != OWN_FAMILY)]:
        valid = np.stack([[is_valid(cfg, family, x, z_theta, user) for x in layouts] for user in users])
        models = {variant: fitted[family, variant] for variant in (*study.variants, MARGIN_ALONE)}
        p = {variant: _stack(models[variant], lambda m: m.p) for variant in models}
        p = {v: x.reshape(len(users), len(seeds), *images.shape[:2], -1) for v, x in p.items()}
        blind = np.stack([baselines.position_only(_prior(cfg, scenes, family, user), z_theta) for user in users])
        in_scenes = {v: x[:, :, 0] for v, x in p.items()}  # (user, seed, scene, path)
        in_scenes[POSITION] = np.repeat(blind[:, None], len(seeds), axis=1)
        for variant, predictions in in_scenes.items():
            key = {"family": family, "variant": variant}
            rows = accuracy_by_seed(predictions, valid[:, 0], users, seeds)
            accuracies.append(pd.DataFrame(key, index=rows.index).join(rows))
            accepted = predictions > DECISION
            before.setdefault(variant, (accepted, valid[:, 0]))
            loss = accuracy_loss(accepted, valid[:, 0], *before[variant])
            training = np.mean([m.training_accuracy for m in models[variant]]) if variant in models else np.nan
            facts = {"training_accuracy": training, "valid": valid[:, 0].mean()}
            summary.append(key | accuracy_estimate(accepted, valid[:, 0]) | loss | facts)
            if variant in p:
                rows = verdicts(users, p[variant], valid)
                judged.append(pd.DataFrame(key, index=rows.index).join(rows))
        posterior = _stack(models[AVERAGED], lambda m: m.posterior)
        posteriors.append(_posterior_table(family, users, seeds, posterior))
    write_table(out_dir / "accuracy.parquet", pd.concat(accuracies, ignore_index=True))
    write_table(out_dir / "summary.csv", pd.DataFrame(summary))
    write_table(out_dir / "verdicts.csv", pd.concat(judged, ignore_index=True))
    write_table(out_dir / "posterior.csv", pd.concat(posteriors, ignore_index=True))


def is_valid(
    cfg: DictConfig, family: str, layouts: Layouts, z_theta: Float[Array, "scene path 2"], user: str
) -> Bool[Array, "scene path"]:
    """Return whether each path [m] is valid to a user whose rule belongs to that family."""
    return FAMILIES[family](layouts, z_theta, cfg.users[user], float(cfg.studies.rule_families.families[family]))


def draw_training_sets(cfg: DictConfig, scenes: SceneSet) -> dict[str, list[TrainingSet]]:
    """Return the demonstrations of every user and seed, relabelled by each family."""
    demos, by_family = read_demos(Path(cfg.paths.demos)), {}
    for family in cfg.studies.rule_families.families:
        by_family[family] = []
        for user in cfg.evaluate.users:
            for seed in cfg.protocol.seeds:
                (z_theta, _), pool = demo_arrays(demos, seed, user, cfg.main_n_demos), train_pool(seed)
                labels = is_valid(cfg, family, scenes.layouts[pool], z_theta, user)
                by_family[family].append(TrainingSet(user, seed, scenes.images[pool], z_theta, labels))
    return by_family


def fit_all(
    cfg: DictConfig,
    scenes: SceneSet,
    images: UInt8[Array, "version scene 100 100 3"],
    z_theta: Float[Array, "scene path 2"],
) -> dict[tuple[str, str], list[Fitted]]:
    """Fit every variant to every family; return (family, variant) -> predictions by user and seed."""
    by_family = draw_training_sets(cfg, scenes)
    training_sets = [x for sets in by_family.values() for x in sets]
    flat_images, paths = images.reshape(-1, *images.shape[2:]), np.tile(z_theta, (len(images), 1, 1))
    variants: list[str] = [*cfg.studies.rule_families.variants, MARGIN_ALONE]
    each = dict.fromkeys(variants, training_sets)
    answers = refit(with_margin_alone(cfg), each, partial(answer, flat_images, paths), "rule families")
    size = len(training_sets) // len(by_family)
    return {
        (family, variant): fitted[i * size : (i + 1) * size]
        for variant, fitted in answers.items()
        for i, family in enumerate(by_family)
    }


def with_margin_alone(cfg: DictConfig) -> DictConfig:
    """Return the parameters with variant MARGIN_ALONE: the clearance model of one family, with as many members."""
    members = cfg.variants[AVERAGED].model.members * len(FAMILIES_OF_MODEL)
    cfg = cfg.copy()
    OmegaConf.set_struct(cfg, False)
    cfg.variants[MARGIN_ALONE] = {**cfg.variants[AVERAGED], "model": {"members": members, "families": [OWN_FAMILY]}}
    return cfg


def answer(
    images: UInt8[Array, "image 100 100 3"],
    z_theta: Float[Array, "image path 2"],
    model: ValidityModel,
    training_set: TrainingSet,
) -> Fitted:
    """Return P(valid) of every path [m] in its image, and the accuracy on the model's own demonstrations."""
    correct = (model.probability(training_set.images, training_set.z_theta) > DECISION) == training_set.valid
    posterior = model.posterior().numpy() if isinstance(model, ClearanceModel) else None
    return Fitted(model.probability(images, z_theta), float(correct.mean()), posterior)


def _prior(cfg: DictConfig, scenes: SceneSet, family: str, user: str) -> Float[Array, "side side"]:
    """Return the mean validity of every z_theta over all training scenes, as [y, x]."""
    side, z_theta = cfg.scenes.prior_side, lattice(cfg.scenes.prior_side)
    shares = []
    for seed in cfg.protocol.seeds:
        layouts = scenes.layouts[train_pool(seed)]
        shares.append(is_valid(cfg, family, layouts, np.tile(z_theta, (len(layouts), 1, 1)), user).mean(0))
    return np.mean(shares, axis=0).reshape(side, side)


def _stack(models: list[Fitted], field) -> Array:
    return np.stack([field(model) for model in models])


def _posterior_table(
    family: str, users: list[str], seeds: list[int], posterior: Float[Array, "user_and_seed fitted_family"]
) -> pd.DataFrame:
    keys = pd.MultiIndex.from_product([users, seeds, FITTED_FAMILIES], names=["user", "seed", "fitted_family"])
    rows = pd.DataFrame({"family": family, "probability": posterior.ravel()}, index=keys).reset_index()
    return rows[["family", "seed", "user", "fitted_family", "probability"]]


if __name__ == "__main__":
    launch(main, "rule_families")
