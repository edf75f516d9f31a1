"""Stage confounding: compare association and intervention for a symbol that only co-occurs with the cause.

Models are fitted in a world where glasses stand next to plates (studies.confounding.world). Their effects of added
items in ordinary scenes are then estimated as in stage intervene.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, read_interventions, read_scenes, train_pool
from pipeline.causal.added_items import added_item_effects, verdicts
from pipeline.causal.interventions import estimate_effects
from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from pipeline.stats.crossed import quartiles
from pipeline.stats.scores import DECISION
from pipeline.training.refit import TrainingSet, refit_and_predict
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import valid
from studies.confounding.association import association, passes_near
from studies.confounding.training_sets import Draw, Scenes, demonstrations, draw_all
from studies.confounding.world import CONFOUNDED, CONTROL

Labelled = list[tuple[Layouts, Float[Array, "scene n 2"], Bool[Array, "scene n"]]]  # layouts, z_theta [m], valid
ORDINARY = "ordinary"  # the world of stage scenes
VERSIONS = [ORDINARY, *SYMBOLS, CONFOUNDED, CONTROL]  # scenes of the questions: SYMBOLS are added to ordinary ones
N_QUESTION_VERSIONS = 1 + len(SYMBOLS)  # number of versions used by `verdicts`


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write association.csv, effects.csv, accuracy.csv, and examples.npz: images of training scenes of each world."""
    study, users, seeds = cfg.studies.confounding, list(cfg.studies.confounding.users), list(cfg.protocol.seeds)
    scenes = read_scenes(Path(cfg.paths.scenes))
    layouts, images, z_theta = read_versions(cfg, scenes)
    keys = [(world, seed) for world in study.worlds for seed in seeds]
    orders = [Draw(train_pool(seed), world, cfg.scenes.per_seed, "train") for world, seed in keys]
    drawn = dict(zip(keys, draw_all(cfg, orders), strict=True))
    training = {
        (world, user, seed): (x.layouts, *demonstrations(cfg, x.layouts, user, seed))
        for (world, seed), x in drawn.items()
        for user in users
    }

    demos = read_demos(Path(cfg.paths.demos))
    associations = []
    for world in (ORDINARY, *study.worlds):
        for user in users:
            if world == ORDINARY:
                pairs = [(scenes.layouts[train_pool(s)], *demo_arrays(demos, s, user, cfg.main_n_demos)) for s in seeds]
            else:
                pairs = [training[world, user, s] for s in seeds]
            rows = association_by_symbol(pairs, study.near_m)
            associations.append(pd.DataFrame({"world": world, "user": user}, index=rows.index).join(rows))

    p = fit_and_predict(cfg, drawn, training, images, z_theta)
    truth = np.stack([[valid(x, z_theta, cfg.users[user]) for x in layouts] for user in users])
    effects, accuracies = [], []
    for (variant, world), predictions in p.items():
        key = {"world": world, "variant": variant}
        versions = predictions[:, :, :N_QUESTION_VERSIONS]
        rows = verdicts(users, versions, truth[:, :N_QUESTION_VERSIONS])
        if world != CONTROL and (variant, CONTROL) in p:
            control = added_item_effects(p[variant, CONTROL][:, :, :N_QUESTION_VERSIONS])
            shift = estimate_effects(added_item_effects(versions) - control)[["effect", "ci_low", "ci_high", "p_holm"]]
            rows = rows.join(shift.set_axis(["shift", "shift_ci_low", "shift_ci_high", "shift_p_holm"], axis=1))
        effects.append(pd.DataFrame(key, index=rows.index).join(rows))
        rows = accuracy_by_world(users, predictions, truth)
        accuracies.append(pd.DataFrame(key, index=rows.index).join(rows))
    write_table(out_dir / "association.csv", pd.concat(associations, ignore_index=True))
    write_table(out_dir / "effects.csv", pd.concat(effects, ignore_index=True))
    write_table(out_dir / "accuracy.csv", pd.concat(accuracies, ignore_index=True))
    write_arrays(out_dir / "examples.npz", {w: drawn[w, seeds[0]].images[: study.examples] for w in study.worlds})


def read_versions(
    cfg: DictConfig, scenes: SceneSet
) -> tuple[list[Layouts], UInt8[Array, "version scene 100 100 3"], Float[Array, "scene path 2"]]:
    """Return layouts and images of VERSIONS, each with the same number of scenes, and their common paths [m].

    Scenes of the confounded world and of its control use items of the same split as the ordinary ones.
    """
    pool, directory = cfg.protocol.splits[cfg.intervene.split], Path(cfg.paths.intervene)
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    ordinary, first = scenes.layouts[pool], slice(cfg.studies.confounding.scenes)
    added, z_theta = read_interventions(directory, ordinary), read_arrays(directory / "images.npz")["z_theta"]
    if len({len(z_theta), *map(len, (ordinary, *added.layouts))}) != 1:
        raise InputError(f"{directory} holds {len(z_theta)} scenes, {pool} {len(ordinary)}: rerun stage intervene")
    split = read_catalogue(Path(cfg.paths.data)).items["split"].iloc[ordinary.item[ordinary.present][0]]
    count = len(z_theta[first])
    others = draw_all(cfg, [Draw(pool, world, count, str(split)) for world in (CONFOUNDED, CONTROL)])
    layouts = [x[first] for x in (ordinary, *added.layouts)] + [x.layouts for x in others]
    images = [x[first] for x in (scenes.images[pool], *added.images)] + [x.images for x in others]
    return layouts, np.stack(images), z_theta[first]


def association_by_symbol(labelled: Labelled, near_m: float) -> pd.DataFrame:
    """Return the association of invalidity with passing near each symbol, a row per symbol, over all training sets."""
    invalid = np.concatenate([~labels for _, _, labels in labelled])
    rows = {}
    for i, symbol in enumerate(SYMBOLS):
        near = np.concatenate([passes_near(layouts, z_theta, i, near_m) for layouts, z_theta, _ in labelled])
        rows[symbol] = association(invalid, near)._asdict()
    return pd.DataFrame(rows.values(), index=pd.Index(rows, name="symbol")).reset_index()


def fit_and_predict(
    cfg: DictConfig,
    drawn: dict[tuple[str, int], Scenes],
    training: dict[tuple[str, str, int], tuple],
    images: UInt8[Array, "version scene 100 100 3"],
    z_theta: Float[Array, "scene path 2"],
) -> dict[tuple[str, str], Float[Array, "user seed version scene path"]]:
    """Fit every variant in its worlds; return (variant, world) -> P(valid) of every path."""
    study, seeds = cfg.studies.confounding, list(cfg.protocol.seeds)
    training_sets = {
        variant: [
            TrainingSet(user, seed, drawn[world, seed].images, *training[world, user, seed][1:])
            for world in worlds
            for user in study.users
            for seed in seeds
        ]
        for variant, worlds in study.variants.items()
    }
    flat_images, paths = images.reshape(-1, *images.shape[2:]), np.tile(z_theta, (len(images), 1, 1))
    p = refit_and_predict(cfg, training_sets, flat_images, paths, "confounding")
    shape = len(study.users), len(seeds), *images.shape[:2], z_theta.shape[1]
    return {
        (variant, world): p[variant].reshape(len(worlds), *shape)[i]
        for variant, worlds in study.variants.items()
        for i, world in enumerate(worlds)
    }


def accuracy_by_world(
    users: list[str], p: Float[Array, "user seed version scene path"], truth: Bool[Array, "user version scene path"]
) -> pd.DataFrame:
    """Return user, scenes (their world), accuracy with quartiles over seeds, and the accuracy of the majority label."""
    rows = []
    for i, user in enumerate(users):
        for world in (ORDINARY, CONFOUNDED, CONTROL):
            version = VERSIONS.index(world)
            labels = truth[i, version]
            by_seed = ((p[i, :, version] > DECISION) == labels).mean((1, 2))
            share = float(labels.mean())
            rows.append({"user": user, "scenes": world, **quartiles(by_seed), "majority": max(share, 1 - share)})
    return pd.DataFrame(rows).rename(columns={"mean": "accuracy"})


if __name__ == "__main__":
    launch(main, "confounding")
