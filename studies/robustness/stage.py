"""Stage robustness: measure accuracy when images, scenes or labels are worse than in training."""

from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos, read_queries
from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, read_position_prior, read_scenes, train_pool
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.baselines import POSITION
from pipeline.models.trained import check_weights, load_model, predict_all
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.decisions import accuracy_by_seed, accuracy_estimate, accuracy_loss
from pipeline.stats.scores import DECISION
from pipeline.training.refit import TrainingSet, refit_and_predict
from pipeline.world.bezier import lattice
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import LayoutRules, Layouts
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import valid
from pipeline.world.source import ImageSource
from studies.robustness.corruptions import CORRUPTIONS, add_clutter, flip_labels

MAP_SIDE = 50  # cells per side of the maps of P(valid)
Predictions = dict[str, Float[Array, "user seed scene path"]]  # variant -> P(valid)


@dataclass(frozen=True)
class Condition:
    """The same scenes under one corruption of one strength."""

    corruption: str  # "none", one of CORRUPTIONS, "texture", "clutter" or "mislabelled"
    strength: float | int | str  # the name for a texture; conf/ states the units of the others
    images: UInt8[Array, "scene 100 100 3"]
    valid: Bool[Array, "user scene path"]
    layouts: Layouts


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write accuracy.parquet, summary.csv, and examples.npz: the first scene, corrupted, with models' maps."""
    check_weights(cfg)
    users, seeds = list(cfg.evaluate.users), list(cfg.protocol.seeds)
    scenes, catalogue = read_scenes(Path(cfg.paths.scenes)), read_catalogue(Path(cfg.paths.data))
    conditions, z_theta = draw_conditions(cfg, scenes, catalogue)
    judged = [
        *zip(conditions, predict_in_conditions(cfg, conditions, z_theta), strict=True),
        *predict_after_label_noise(cfg, scenes, conditions[0], z_theta),
    ]

    uncorrupted, predictions_before = judged[0]
    accuracies, summary = [], []
    for condition, predictions in judged:
        key = {"corruption": condition.corruption, "strength": str(condition.strength)}
        for variant, p in predictions.items():
            rows = accuracy_by_seed(p, condition.valid, users, seeds)
            accuracies.append(pd.DataFrame(key | {"variant": variant}, index=rows.index).join(rows))
            accepted, accepted_before = p > DECISION, predictions_before[variant] > DECISION
            accuracy = accuracy_estimate(accepted, condition.valid)
            loss = accuracy_loss(accepted, condition.valid, accepted_before, uncorrupted.valid)
            summary.append(key | {"variant": variant} | accuracy | loss)
    write_table(out_dir / "accuracy.parquet", pd.concat(accuracies, ignore_index=True))
    write_table(out_dir / "summary.csv", pd.DataFrame(summary))
    write_arrays(out_dir / "examples.npz", draw_examples(cfg, conditions))


def draw_conditions(
    cfg: DictConfig, scenes: SceneSet, catalogue: Catalogue
) -> tuple[list[Condition], Float[Array, "scene path 2"]]:
    """Return the scenes without and with every corruption, weakest first, and their common paths [m].

    Raises InputError if the split lacks scenes or queries, or the catalogue a texture.
    """
    study, users = cfg.studies.robustness, list(cfg.evaluate.users)
    pool = cfg.protocol.splits[study.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    queries = read_queries(Path(cfg.paths.demos)).get(pool)
    if queries is None or not set(users) <= set(queries.valid):
        raise InputError(f"no queries of {', '.join(users)} in {pool}: run the demos stage again")
    if (count := len(scenes.images[pool])) < study.scenes:
        raise InputError(f"studies.robustness.scenes is {study.scenes}: expected at most {count}, as {pool} has")
    if not set(study.textures) <= set(unseen := catalogue.texture_names("unseen")):
        raise InputError(f"studies.robustness.textures is {list(study.textures)}: expected some of {', '.join(unseen)}")

    first = slice(study.scenes)
    images, layouts = scenes.images[pool][first], scenes.layouts[pool][first]
    appearance = scenes.appearances[pool][first]
    textures, render_seeds = appearance["texture"].tolist(), appearance["render_seed"].tolist()
    z_theta, truth = queries.z[first], np.stack([queries.valid[user][first] for user in users])
    render = partial(render_scenes, palette=Palette(catalogue, ImageSource.of(cfg.scenes.source)))

    conditions = [Condition("none", 0, images, truth, layouts)]
    for name, strengths in study.corruptions.items():
        for strength in strengths or ():
            corrupted = CORRUPTIONS[name](stream(study.root_seed, name), images, float(strength))
            conditions.append(Condition(name, strength, corrupted, truth, layouts))
    for texture in study.textures:
        on_texture = render(layouts, [texture] * len(layouts), render_seeds)
        conditions.append(Condition("texture", texture, on_texture, truth, layouts))
    rules = LayoutRules.of(cfg.scenes.layout)
    items = catalogue.pool(str(catalogue.items["split"].iloc[layouts.item[layouts.present][0]]))
    for count in study.clutter:
        fuller = add_clutter(stream(study.root_seed, "clutter"), layouts, count, catalogue.footprints, items, rules)
        truth_there = np.stack([valid(fuller, z_theta, cfg.users[user]) for user in users])
        conditions.append(Condition("clutter", count, render(fuller, textures, render_seeds), truth_there, fuller))
    return conditions, z_theta


def draw_examples(cfg: DictConfig, conditions: list[Condition]) -> dict[str, Array]:
    """Return the first scene in the strongest form of each corruption and on each texture.

    names: "corruption strength"; images: uint8 (example, 100, 100, 3); truth: bool (example, user, side, side) as
    [y, x] on `lattice(MAP_SIDE)`; each variant: P(valid) of the same shape, by the first seed's models.
    """
    users, seed = list(cfg.evaluate.users), cfg.protocol.seeds[0]
    strongest = {(c.corruption, c.strength if c.corruption == "texture" else ""): c for c in conditions}
    shown = list(strongest.values())
    shape, cells = (len(shown), len(users), MAP_SIDE, MAP_SIDE), np.tile(lattice(MAP_SIDE), (len(shown), 1, 1))
    images = np.stack([c.images[0] for c in shown])
    truth = [[valid(c.layouts[:1], cells[:1], cfg.users[user]) for user in users] for c in shown]
    examples = {"names": np.array([f"{c.corruption} {c.strength}" for c in shown]), "images": images}
    examples["truth"] = np.reshape(truth, shape)
    for variant in cfg.variants:
        models = [load_model(cfg, variant, user, seed, cfg.main_n_demos) for user in users]
        p = np.stack([model.probability(images, cells) for model in models], axis=1)
        examples[variant] = p.reshape(shape).astype(np.float32)
    return examples


def predict_in_conditions(
    cfg: DictConfig, conditions: list[Condition], z_theta: Float[Array, "scene path 2"]
) -> list[Predictions]:
    """Return P(valid) of every variant and of the image-blind baseline position_only under each condition."""
    users, seeds = list(cfg.evaluate.users), list(cfg.protocol.seeds)
    images = np.concatenate([condition.images for condition in conditions])
    paths = np.tile(z_theta, (len(conditions), 1, 1))
    p = predict_all(cfg, users, images, paths, "robustness")
    prior = read_position_prior(Path(cfg.paths.scenes))
    blind = np.stack([baselines.position_only(prior[user], paths) for user in users])[:, None]
    p[POSITION] = np.repeat(blind, len(seeds), axis=1)
    by_condition = {variant: np.split(x, len(conditions), axis=2) for variant, x in p.items()}
    return [{variant: x[i] for variant, x in by_condition.items()} for i in range(len(conditions))]


def predict_after_label_noise(
    cfg: DictConfig, scenes: SceneSet, uncorrupted: Condition, z_theta: Float[Array, "scene path 2"]
) -> list[tuple[Condition, Predictions]]:
    """Return P(valid) in the uncorrupted scenes of models fitted to partly flipped labels, by flipped share."""
    users, seeds, demos = list(cfg.evaluate.users), list(cfg.protocol.seeds), read_demos(Path(cfg.paths.demos))
    study = cfg.studies.robustness

    def noisy(share: float, user: str, seed: int) -> TrainingSet:
        paths, labels = demo_arrays(demos, seed, user, cfg.main_n_demos)
        rng = stream(study.root_seed, "mislabelled", user, seed)
        return TrainingSet(user, seed, scenes.images[train_pool(seed)], paths, flip_labels(rng, labels, float(share)))

    training_sets = {
        variant: [noisy(*key) for key in product(shares, users, seeds)] for variant, shares in study.mislabelled.items()
    }
    refitted = refit_and_predict(cfg, training_sets, uncorrupted.images, z_theta, "mislabelled")
    by_share: dict[float, Predictions] = {x: {} for x in sorted({x for xs in study.mislabelled.values() for x in xs})}
    for variant, shares in study.mislabelled.items():
        p = refitted[variant].reshape(len(shares), len(users), len(seeds), *z_theta.shape[:2])
        for share, p_of_share in zip(shares, p, strict=True):
            by_share[share][variant] = p_of_share
    return [(replace(uncorrupted, corruption="mislabelled", strength=share), p) for share, p in by_share.items()]


if __name__ == "__main__":
    launch(main, "robustness")
