"""Stage shift: judge models where images, table tops, items, labels or the user's rule are not those of training.

Fitted models judge the same paths in disturbed scenes. For wrong labels and for another rule, models are fitted again.
"""

from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import asked, read_queries
from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, Versions, read_position_prior, read_scenes, read_versions, train_pool
from pipeline.causal.interventions import verdicts
from pipeline.launch import launch
from pipeline.models.baselines import POSITION, position_only
from pipeline.models.clearance.clearance import FAMILIES
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Counts, Distance, Several, Shares, Some, Strengths, StudyGroup, Whole, need
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import Items as Held
from pipeline.stats.crossed import items_held
from pipeline.stats.scores import DECISION, accuracy_estimate
from pipeline.training.refit import TrainingSet, demonstrations, refit_and_predict
from pipeline.world import layout
from pipeline.world.bezier import curve, lattice
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, Items, LayoutRules, Layouts
from pipeline.world.render import ImageSource, Palette, render_scenes
from pipeline.world.rules import SAMPLES, Margins, valid

RULES = OWN_RULE, PROXIMITY = "margin", "proximity"  # that of conf/users.yaml, and only items with a neighbour count
ARM_RADIUS_PX = 4  # an arm is 8 cm wide; a pixel is 1 cm
PIXEL_CENTRES = (np.arange(SIDE) + 0.5) / SIDE  # centres of rows and columns [m]
WARM_LIGHT = np.array([0.0, 0.5, 1.0])  # share of the loss in red, green and blue
Images = UInt8[Array, "scene 100 100 3"]
Paths = Float[Array, "scene path 2"]
Predictions = dict[str, Float[Array, "user seed scene path"]]  # variant -> P(valid)


class Settings(StudyGroup):
    root_seed: Whole
    scenes: Several
    corruptions: dict[Literal["shade", "tint", "blur", "noise", "arm"], Strengths]
    textures: Some
    clutter: Counts
    mislabelled: dict[Literal["train", "irl", "clearance"], Shares]
    rule_scenes: Several
    neighbour_m: Distance


def agree(study: Settings, parameters: Any) -> None:
    """Require enough scenes in the split, and a clearance model."""
    shared, stages = parameters.scenes.shared, [variant.stage for variant in parameters.variants.values()]
    need(study.scenes <= shared, "studies.shift.scenes", study.scenes, f"at most scenes.shared = {shared}")
    need("clearance" in stages, "variants", list(parameters.variants), "one of stage clearance among them")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Judge fitted models under every disturbance, then models fitted again to wrong labels and to another rule."""
    check_weights(cfg)
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    judge_disturbances(cfg, scenes, pool, out_dir)
    judge_rules(cfg, scenes, out_dir)


# Disturbances


@dataclass(frozen=True)
class Condition:
    """The same scenes under one disturbance of one strength."""

    corruption: str  # "none", one of CORRUPTIONS, "texture", "clutter" or "mislabelled"
    strength: float | int | str  # the name for a texture; conf/ states the units of the others
    images: Images
    valid: Bool[Array, "user scene path"]
    items: Held  # of each scene


def judge_disturbances(cfg: DictConfig, scenes: SceneSet, pool: str, out_dir: Path) -> None:
    """Write disturbances.csv, by_seed.csv for sweeps, and examples.npz: the first scene under each disturbance."""
    conditions, z_theta = draw_conditions(cfg, scenes, pool)
    judged = list(zip(conditions, predict_in_conditions(cfg, conditions, z_theta), strict=True))
    judged += predict_after_label_noise(cfg, scenes, conditions[0], z_theta)
    summary, by_seed = [], []
    for x, (variant, p) in ((x, one) for x, predictions in judged for one in predictions.items()):
        key = {"corruption": x.corruption, "strength": str(x.strength), "variant": variant}
        summary.append(key | accuracy_estimate(p > DECISION, x.valid, x.items))
        right = ((p > DECISION) == x.valid[:, None]).mean((0, 2, 3))  # (seed,); the blind baseline has one
        by_seed.append(pd.DataFrame(key | {"seed": list(cfg.protocol.seeds)[: len(right)], "accuracy": right}))
    write_table(out_dir / "disturbances.csv", pd.DataFrame(summary))
    write_table(out_dir / "by_seed.csv", pd.concat(by_seed, ignore_index=True))
    write_arrays(out_dir / "examples.npz", {f"{x.corruption} {x.strength}": x.images[0] for x in conditions})


def draw_conditions(cfg: DictConfig, scenes: SceneSet, pool: str) -> tuple[list[Condition], Paths]:
    """Return the scenes without and with every disturbance, weakest first, and their common paths [m].

    Raises InputError if the pool lacks queries, or the catalogue a texture.
    """
    study, users, catalogue = cfg.studies.shift, list(cfg.evaluate.users), read_catalogue(Path(cfg.paths.data))
    first, queries = slice(study.scenes), read_queries(Path(cfg.paths.demos))
    paths, labels = zip(*(asked(queries, pool, user) for user in users), strict=True)
    z_theta, truth = paths[0][first], np.stack(labels)[:, first]
    if not set(study.textures) <= set(unseen := catalogue.texture_names("unseen")):
        raise InputError(f"studies.shift.textures is {list(study.textures)}: expected some of {', '.join(unseen)}")

    images, layouts = scenes.images[pool][first], scenes.layouts[pool][first]
    appearance = scenes.appearances[pool][first]
    textures, render_seeds = appearance["texture"].tolist(), appearance["render_seed"].tolist()
    render = partial(render_scenes, palette=Palette(catalogue, ImageSource.of(cfg.scenes.source)))

    held = items_held(layouts.item, layouts.symbol)
    conditions = [Condition("none", 0, images, truth, held)]
    for name, strengths in study.corruptions.items():
        for strength in strengths:
            corrupted = CORRUPTIONS[name](stream(study.root_seed, name), images, float(strength))
            conditions.append(Condition(name, strength, corrupted, truth, held))
    for texture in study.textures:
        on_texture = render(layouts, [texture] * len(layouts), render_seeds)
        conditions.append(Condition("texture", texture, on_texture, truth, held))
    rules = LayoutRules.of(cfg.scenes.layout)
    items = catalogue.pool(str(catalogue.items["split"].iloc[layouts.item[layouts.present][0]]))
    for count in study.clutter:
        fuller = add_clutter(stream(study.root_seed, "clutter"), layouts, count, catalogue.footprints, items, rules)
        truth_there = np.stack([valid(fuller, z_theta, cfg.users[user]) for user in users])
        pictures, all_items = render(fuller, textures, render_seeds), items_held(fuller.item, fuller.symbol)
        conditions.append(Condition("clutter", count, pictures, truth_there, all_items))
    return conditions, z_theta


def predict_in_conditions(cfg: DictConfig, conditions: list[Condition], z_theta: Paths) -> list[Predictions]:
    """Return P(valid) of every variant and of the image-blind baseline position_only under each condition."""
    users = list(cfg.evaluate.users)
    images = np.concatenate([condition.images for condition in conditions])
    paths = np.tile(z_theta, (len(conditions), 1, 1))
    p = predict_all(cfg, users, images, paths, "disturbances")
    prior = read_position_prior(Path(cfg.paths.scenes))
    p[POSITION] = np.stack([position_only(prior[user], paths) for user in users])[:, None]
    by_condition = {variant: np.split(x, len(conditions), axis=2) for variant, x in p.items()}
    return [{variant: x[i] for variant, x in by_condition.items()} for i in range(len(conditions))]


def predict_after_label_noise(
    cfg: DictConfig, scenes: SceneSet, undisturbed: Condition, z_theta: Paths
) -> list[tuple[Condition, Predictions]]:
    """Return P(valid) in the undisturbed scenes of models fitted to partly flipped labels, by flipped share."""
    study, compared = cfg.studies.shift, [name for name, variant in cfg.variants.items() if variant.compared]
    shares = {v: [float(x) for x in study.mislabelled.get(cfg.variants[v].stage, ())] for v in compared}

    def flipped(t: TrainingSet, share: float) -> TrainingSet:
        return replace(t, valid=flip_labels(stream(study.root_seed, "mislabelled", t.user, t.seed), t.valid, share))

    demos, every_share = demonstrations(cfg, scenes), sorted({x for xs in shares.values() for x in xs})
    noisy = {share: [flipped(t, share) for t in demos] for share in every_share}
    training_sets = {v: [one for share in xs for one in noisy[share]] for v, xs in shares.items() if xs}
    refitted = refit_and_predict(cfg, training_sets, undisturbed.images, z_theta, "wrong labels")
    shape = len(cfg.evaluate.users), len(cfg.protocol.seeds), *z_theta.shape[:2]
    by_share: dict[float, Predictions] = {share: {} for share in noisy}
    for variant, p in refitted.items():
        for share, p_of_share in zip(shares[variant], p.reshape(-1, *shape), strict=True):
            by_share[share][variant] = p_of_share
    return [(replace(undisturbed, corruption="mislabelled", strength=share), p) for share, p in by_share.items()]


# Another rule


def judge_rules(cfg: DictConfig, scenes: SceneSet, out_dir: Path) -> None:
    """Write rules.csv and verdicts.csv: clearance models fitted to each rule, and judged by it.

    Each variant of stage clearance is also fitted with family `margin` alone, without averaging over families, and then
    called `<variant>_margin`.
    """
    users, seeds, summary, judged = list(cfg.evaluate.users), list(cfg.protocol.seeds), [], []
    images, layouts, z_theta = versions = read_versions(cfg, scenes, cfg.studies.shift.rule_scenes)
    items = items_held(layouts[0].item, layouts[0].symbol)
    for rule, by_variant in fit_to_rules(cfg, scenes, versions).items():
        labels = np.stack([[is_valid(cfg, rule, x, z_theta, user) for x in layouts] for user in users])
        p = {v: x.reshape(len(users), len(seeds), *images.shape[:2], -1) for v, x in by_variant.items()}
        in_scenes, priors = {v: x[:, :, 0] for v, x in p.items()}, [position_prior(cfg, scenes, rule, u) for u in users]
        in_scenes[POSITION] = np.stack([position_only(prior, z_theta) for prior in priors])[:, None]
        for variant, p_in_scenes in in_scenes.items():
            estimates = accuracy_estimate(p_in_scenes > DECISION, labels[:, 0], items)
            summary.append({"family": rule, "variant": variant} | estimates | {"valid": labels[:, 0].mean()})
        for variant, of_variant in p.items():
            rows = verdicts(users, of_variant, labels, layouts)
            judged.append(pd.DataFrame({"family": rule, "variant": variant}, index=rows.index).join(rows))
    write_table(out_dir / "rules.csv", pd.DataFrame(summary))
    write_table(out_dir / "verdicts.csv", pd.concat(judged, ignore_index=True))


def fit_to_rules(cfg: DictConfig, scenes: SceneSet, versions: Versions) -> dict[str, dict[str, Array]]:
    """Fit each variant of stage clearance, averaged and with one family, to every rule; return P(valid) by both.

    P(valid) is that of every path in every version of the scenes, first axis: user and seed.
    """
    every_set = [
        replace(t, valid=is_valid(cfg, rule, scenes.layouts[train_pool(t.seed)], t.z_theta, t.user))
        for rule, t in product(RULES, demonstrations(cfg, scenes))
    ]
    averaged = {name: variant for name, variant in cfg.variants.items() if variant.stage == "clearance"}
    cfg = cfg.copy()
    OmegaConf.set_struct(cfg, False)
    for name, variant in averaged.items():
        members = variant.model.members * len(FAMILIES)  # as many as the averaged model has in all
        model = {**variant.model, "members": members, "families": [OWN_RULE]}
        cfg.variants[f"{name}_{OWN_RULE}"] = {**variant, "model": model}
    images, paths = np.concatenate(versions.images), np.tile(versions.z_theta, (len(versions.images), 1, 1))
    fitted = dict.fromkeys([*averaged, *(f"{name}_{OWN_RULE}" for name in averaged)], every_set)
    p = refit_and_predict(cfg, fitted, images, paths, "rules")
    return {rule: {v: np.split(x, len(RULES))[i] for v, x in p.items()} for i, rule in enumerate(RULES)}


def position_prior(cfg: DictConfig, scenes: SceneSet, rule: str, user: str) -> Float[Array, "side side"]:
    """Return the mean validity of every z_theta over all training scenes, as [y, x]."""
    side, z_theta = cfg.scenes.prior_side, lattice(cfg.scenes.prior_side)
    shares = []
    for seed in cfg.protocol.seeds:
        layouts = scenes.layouts[train_pool(seed)]
        shares.append(is_valid(cfg, rule, layouts, np.tile(z_theta, (len(layouts), 1, 1)), user).mean(0))
    return np.mean(shares, axis=0).reshape(side, side)


def is_valid(cfg: DictConfig, rule: str, layouts: Layouts, z_theta: Paths, user: str) -> Bool[Array, "scene path"]:
    """Return whether each path [m] is valid to the user, whose rule is OWN_RULE or PROXIMITY."""
    if rule == OWN_RULE:
        return valid(layouts, z_theta, cfg.users[user])
    return proximity(layouts, z_theta, cfg.users[user], cfg.studies.shift.neighbour_m)


def proximity(layouts: Layouts, z_theta: Paths, margins: Margins, within_m: float) -> Bool[Array, "scene path"]:
    """Return whether each path keeps the margins of items that have a neighbour.

    A neighbour is any other item whose footprint is at most `within_m` [m] away.
    """
    gap = layout.segment_distance(layouts.ends[:, :, None], layouts.ends[:, None])  # (scene, slot, slot)
    gap = gap - layouts.radius[:, :, None] - layouts.radius[:, None]
    other = layouts.present[:, :, None] & layouts.present[:, None] & ~np.eye(gap.shape[1], dtype=bool)
    has_neighbour = np.any(other & (gap <= within_m), axis=-1)  # (scene, slot)
    margin = np.array([np.nan if margins[s] is None else margins[s] for s in SYMBOLS] + [np.nan])[layouts.symbol]
    points, broken = curve(z_theta, SAMPLES), np.zeros(z_theta.shape[:2], bool)
    for slot in range(gap.shape[1]):
        distance = layout.point_segment_distance(points, *np.moveaxis(layouts.ends[:, slot, None, None], 3, 0))
        reach = (layouts.radius[:, slot] + margin[:, slot])[:, None]  # NaN without a margin: never broken
        broken |= has_neighbour[:, slot, None] & (distance.min(-1) < reach)
    return ~broken


# Corruptions. With the same generator, a stronger one extends a weaker one: the shadow falls on the same side, the arm
# reaches further at the same place, and added items and label errors include the weaker ones.


def shade(rng: np.random.Generator, images: Images, loss: float) -> Images:
    """Return the images darkened linearly across the table, by the share `loss` at the far end.

    Each image has a random direction.
    """
    bearing = rng.uniform(-np.pi, np.pi, (len(images), 1, 1))
    c, s = np.cos(bearing), np.sin(bearing)
    along = c * (PIXEL_CENTRES - 0.5) + s * (PIXEL_CENTRES[:, None] - 0.5)
    distance = 0.5 + along / (abs(c) + abs(s))  # (scene, row, column), 0 to 1
    return _to_uint8(images / 255 * (1 - loss * distance[..., None]))


def tint(rng: np.random.Generator, images: Images, loss: float) -> Images:
    """Return the images under warmer light: without the share `loss` of the blue and half as much of the green."""
    return _to_uint8(images / 255 * (1 - loss * WARM_LIGHT))


def blur(rng: np.random.Generator, images: Images, sigma_px: float) -> Images:
    """Return the images blurred by a Gaussian of this standard deviation [px]."""
    unit = (images / 255).astype(np.float32)
    return _to_uint8(np.stack([cv2.GaussianBlur(x, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE) for x in unit]))


def noise(rng: np.random.Generator, images: Images, sigma: float) -> Images:
    """Return the images with normal noise of this standard deviation [1 = white] on every pixel and channel."""
    return _to_uint8(images / 255 + sigma * rng.standard_normal(images.shape))


def arm(rng: np.random.Generator, images: Images, reach_m: float) -> Images:
    """Return the images with a grey arm that reaches straight in from a random edge by `reach_m` [m]."""
    corrupted = images.copy()
    for image in corrupted:
        edge, column, grey = int(rng.integers(4)), round(SIDE * rng.uniform(0.15, 0.85)), rng.uniform(0.2, 0.8)
        tip = round(SIDE * reach_m) - 1 - ARM_RADIUS_PX  # row of the round end's centre
        mask = np.zeros((SIDE, SIDE), np.uint8)
        cv2.line(mask, (column, -2 * ARM_RADIUS_PX), (column, tip), 1, thickness=2 * ARM_RADIUS_PX)
        image[np.rot90(mask, edge) > 0] = round(255 * grey)
    return corrupted


CORRUPTIONS = {f.__name__: f for f in (shade, tint, blur, noise, arm)}


def _to_uint8(images: Float[Array, "*shape"]) -> UInt8[Array, "*shape"]:
    return np.rint(np.clip(images, 0, 1) * 255).astype(np.uint8)


def add_clutter(
    rng: np.random.Generator, layouts: Layouts, count: int, items: Items, pool: Int[Array, " pool"], rules: LayoutRules
) -> Layouts:
    """Return the scenes with `count` additional items of `pool` (catalogue rows), of random symbols.

    Items keep the minimum distances of `rules`. Raises InputError if a scene has no room for them.
    """
    scenes = []
    for i, scene_rng in enumerate(rng.spawn(len(layouts))):
        scene = layout.concatenated([layouts[[i]], layout.empty(1, layouts.symbol.shape[1] + count)])[:1]
        for _ in range(count):
            scene = layout.add_item(scene_rng, scene, int(scene_rng.integers(len(SYMBOLS))), items, pool, rules)
        scenes.append(scene)
    return layout.concatenated(scenes)


def flip_labels(rng: np.random.Generator, valid: Bool[Array, "scene n"], share: float) -> Bool[Array, "scene n"]:
    """Return the labels with this share flipped at random, rounded to a whole number of labels."""
    flipped = np.zeros(valid.size, dtype=bool)
    flipped[rng.permutation(valid.size)[: round(share * valid.size)]] = True
    return valid ^ flipped.reshape(valid.shape)


if __name__ == "__main__":
    launch(main, "shift")
