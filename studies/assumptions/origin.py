"""Find where an effect's error arises: in seeing items, in telling kinds apart, or in the rule.

The percept is set to the truth in two steps, do(Z_I := true outlines) and do(Z_I := true outlines, typical looks of the
true kind), and the effect of an added item is asked again: what a step changes is that part's share of the error. The
clearance model takes objects; a reward map takes contrasts with the table, which are 0 outside the outlines.
"""

from collections.abc import Sequence
from functools import partial
from itertools import product

import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.scenes import SceneSet, Versions, train_pool
from pipeline.causal.interventions import added_item_effects, added_items, estimate_effects, questions
from pipeline.models.base import SCENES_PER_BATCH, Paths, to_tensor
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.irl.reward_map import Contrasts, RewardMap, contrast, turned
from pipeline.models.trained import load_model
from pipeline.perception.background import subtract_background
from pipeline.perception.objects import SUPERSAMPLING, Object, Objects, Outline, describe_outlined
from pipeline.runtime.parallel import map_jobs
from pipeline.world.layout import SIDE, SYMBOLS, Layouts, concatenated, point_segment_distance
from pipeline.world.rules import valid

PICTURE, OUTLINES, KINDS = "picture", "outlines", "kinds"  # percepts, each with more truth than the one before
PARTS = {"seeing": (PICTURE, OUTLINES), "telling kinds apart": (OUTLINES, KINDS), "the rule": (KINDS, None)}
SMOOTHING_M = 0.02  # contrasts are smoothed over two pixels: an item's reach that far beyond its outline


def inside(layouts: Layouts, side: int, beyond_m: float = 0.0) -> Bool[Array, "scene slot side side"]:
    """Return the pixels, of images of that side, that each item covers with `beyond_m` [m] around it."""
    row, column = (np.indices((side, side)).reshape(2, -1) + 0.5) / side
    distance = point_segment_distance(np.stack([column, 1 - row], -1), *np.moveaxis(layouts.ends[:, :, :, None], 2, 0))
    covered = (distance < layouts.radius[..., None] + beyond_m) & layouts.present[..., None]
    return covered.reshape(*covered.shape[:2], side, side)


def true_objects(image: UInt8[Array, "100 100 3"], scene: Layouts) -> list[Object]:
    """Return the objects of the one scene within their true outlines, looking as the picture shows them."""
    masks = inside(scene, SIDE * SUPERSAMPLING)[0, scene.present[0]]
    return describe_outlined(image, [Outline(mask.astype(np.uint8), 0, 0) for mask in masks])


def mediate(cfg: DictConfig, variants: Sequence[str], scenes: SceneSet, asked: Versions) -> pd.DataFrame:
    """Return what each part of a model adds to the error of each effect.

    effect: of the picture; error: less the truth; share: what the part adds to the error, with a 95 % interval.
    """
    users, seeds = list(cfg.evaluate.users), list(cfg.protocol.seeds)
    images, layouts, z_theta = asked
    told = [true_objects(images[v, i], layouts[v][[i]]) for v, i in np.ndindex(images.shape[:2])]
    given = partial(_by_percept, cfg, variants, scenes, asked, told)
    answers = np.stack(map_jobs(given, seeds, cfg.workers, "mediation"), axis=2)  # (variant, user, seed, percept, ...)
    items = np.tile(added_items(layouts), (len(users), 1, 1))
    truth = np.stack([[valid(x, z_theta, cfg.users[user]) for x in layouts] for user in users])
    true_effects = added_item_effects(truth[:, None].astype(float))  # (question, 1, scene)
    rows = []
    for variant, p in zip(variants, answers, strict=True):
        effects = {name: added_item_effects(p[:, :, i]) for i, name in enumerate((PICTURE, OUTLINES, KINDS))}
        error = (effects[PICTURE] - true_effects).mean((1, 2))
        for part, (before, after) in PARTS.items():
            share = estimate_effects(effects[before] - (effects[after] if after else true_effects), items)
            columns = share[["effect", "ci_low", "ci_high"]].rename(columns={"effect": "share"})
            facts = {"variant": variant, "part": part, "effect": effects[PICTURE].mean((1, 2)), "error": error}
            rows.append(questions(users).assign(**facts).join(columns))
    return pd.concat(rows, ignore_index=True)


def _by_percept(
    cfg: DictConfig, variants: Sequence[str], scenes: SceneSet, asked: Versions, told: list[list[Object]], seed: int
) -> Float[Array, "variant user percept version scene path"]:
    """Return P(valid) by a seed's models: by picture, by true outlines, and by these with typical looks."""
    pictures, layouts = np.concatenate(asked.images), concatenated(asked.layouts)
    z_theta = np.tile(asked.z_theta, (len(asked.images), 1, 1))
    training = scenes.images[train_pool(seed)], scenes.layouts[train_pool(seed)]
    objects, maps = [told, _typical_objects(told, layouts, *training)], _true_contrasts(pictures, layouts, *training)
    answers = []
    for variant, user in product(variants, cfg.evaluate.users):
        model = load_model(cfg, variant, user, seed, cfg.main_n_demos)
        if isinstance(model, ClearanceModel):
            sure = [0.0] * len(told)
            percepts = pictures, *(Objects.of(each, sure, kinds=model.kinds) for each in objects)
            answers.append([model.probability(percept, z_theta) for percept in percepts])
        else:
            assert isinstance(model, RewardMap)
            answers.append([_by_contrasts(model, each, torch.from_numpy(z_theta).float()) for each in maps])
    shape = len(variants), len(cfg.evaluate.users), len(PARTS), *asked.images.shape[:2], -1
    return np.array(answers).reshape(shape)


def _typical_objects(told: list[list[Object]], layouts: Layouts, images: Array, laid: Layouts) -> list[list[Object]]:
    """Return the objects told, each with the mean features and looks of its kind in training pictures, if any."""
    alike: dict[int, list[Object]] = {}
    for image, scene in zip(images, (laid[[i]] for i in range(len(laid))), strict=True):
        for kind, one in zip(scene.symbol[scene.present].tolist(), true_objects(image, scene), strict=True):
            alike.setdefault(kind, []).append(one)
    fields = "features", "looks"
    typical = {k: {name: np.mean([getattr(x, name) for x in xs], axis=0) for name in fields} for k, xs in alike.items()}
    kinds = [layouts.symbol[i][layouts.present[i]].tolist() for i in range(len(layouts))]
    return [
        [one._replace(**typical.get(kind, {})) for one, kind in zip(*scene, strict=True)]
        for scene in zip(told, kinds, strict=True)
    ]


def _true_contrasts(pictures: Array, layouts: Layouts, images: Array, laid: Layouts) -> list[Contrasts]:
    """Return the pictures' contrasts: as they are, 0 but at items, and there the mean of the kind in training."""
    shown, (near, known) = _contrasts(pictures), (inside(x, SIDE, SMOOTHING_M) for x in (layouts, laid))
    outlined = shown * torch.from_numpy(near.any(1))[:, None]
    named, training = outlined.clone().movedim(1, -1), _contrasts(images).movedim(1, -1)
    for kind in range(len(SYMBOLS)):
        here, there = ((x & (of.symbol == kind)[..., None, None]).any(1) for x, of in ((near, layouts), (known, laid)))
        if there.any():
            named[torch.from_numpy(here)] = training[torch.from_numpy(there)].mean(0)
    return [shown, outlined, named.movedim(-1, 1)]


def _contrasts(images: UInt8[Array, "scene 100 100 3"]) -> Contrasts:
    return contrast(*subtract_background(to_tensor(images)))


@torch.no_grad()
def _by_contrasts(model: RewardMap, maps: Contrasts, z_theta: Paths) -> Float[Array, "scene path"]:
    """Return P(valid) of each path by its scene's contrasts with the table."""
    pairs = zip(maps.split(SCENES_PER_BATCH), z_theta.split(SCENES_PER_BATCH), strict=True)
    return torch.cat([model.logit(model.perceive_turned(turned(x)), z).sigmoid() for x, z in pairs]).numpy()
