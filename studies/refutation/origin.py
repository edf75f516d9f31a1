"""Where an effect arises, and whether it was asked where training had been.

A model errs because it sees an item wrongly, tells its kind wrongly, or has the wrong rule. The percept is set to the
truth in two steps, do(Z_I := true outlines) and do(Z_I := true outlines, typical looks of the true kind), and the
effect of an added item is asked again: what a step changes is that part's share of the error.
"""

from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_table
from pipeline.artifacts.scenes import SceneSet, Versions, read_interventions, train_pool
from pipeline.causal.interventions import (
    added_item_effects,
    added_items,
    compare_with_truth,
    estimate_effects,
    questions,
)
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.trained import load_model
from pipeline.perception.objects import SUPERSAMPLING, Object, Objects, Outline, describe_outlined
from pipeline.runtime.parallel import map_jobs
from pipeline.world.layout import SIDE, SYMBOLS, Layouts, point_segment_distance
from pipeline.world.rules import valid

READS_OBJECTS = "clearance"  # the stage of variants that take objects in place of pictures
PICTURE, OUTLINES, KINDS = "picture", "outlines", "kinds"  # percepts, each with more truth than the one before
PARTS = {"seeing": (PICTURE, OUTLINES), "telling kinds apart": (OUTLINES, KINDS), "the rule": (KINDS, None)}
NO_SUCH_KIND_M = 1.0  # distance to an item of a kind that a training scene does not have


def true_objects(image: UInt8[Array, "100 100 3"], scene: Layouts) -> list[Object]:
    """Return the objects of the one scene within their true outlines, looking as the picture shows them."""
    grid = (np.indices((SIDE * SUPERSAMPLING,) * 2) + 0.5) / (SIDE * SUPERSAMPLING)
    points = np.stack([grid[1], 1 - grid[0]], -1).reshape(-1, 2)
    slots = np.flatnonzero(scene.present[0])
    distances = [point_segment_distance(points, *scene.ends[0, slot][:, None]) for slot in slots]
    masks = [(d < r).reshape(grid.shape[1:]) for d, r in zip(distances, scene.radius[0, slots], strict=True)]
    return describe_outlined(image, [Outline(mask.astype(np.uint8), 0, 0) for mask in masks])


def ask_where_errors_arise(cfg: DictConfig, scenes: SceneSet, asked: Versions, out_dir: Path) -> None:
    """Write mediation.csv: what each part of a model adds to the error of each effect, of variants that read objects.

    effect: of the picture; error: less the truth; share: what the part adds to the error, with a 95 % interval.
    """
    users, seeds = list(cfg.evaluate.users), list(cfg.protocol.seeds)
    images, layouts, z_theta = asked
    shape = len(layouts), len(z_theta)
    told = [true_objects(images[v, i], layouts[v][[i]]) for v, i in np.ndindex(shape)]
    kinds = [layouts[v].symbol[i][layouts[v].present[i]] for v, i in np.ndindex(shape)]
    items, repeated = np.tile(added_items(layouts), (len(users), 1, 1)), np.tile(z_theta, (len(layouts), 1, 1))
    truth = np.stack([[valid(x, z_theta, cfg.users[user]) for x in layouts] for user in users])
    true_effects = added_item_effects(truth[:, None].astype(float))  # (question, 1, scene)
    rows = []
    for variant in (str(name) for name, v in cfg.variants.items() if v.stage == READS_OBJECTS):
        given = partial(_by_percept, cfg, variant, scenes, np.concatenate(images), repeated, told, kinds)
        p = np.stack(map_jobs(given, list(product(users, seeds)), cfg.workers, "mediation"))
        p = p.reshape(len(users), len(seeds), len(PARTS), *shape, -1)
        effects = {name: added_item_effects(p[:, :, i]) for i, name in enumerate((PICTURE, OUTLINES, KINDS))}
        error = (effects[PICTURE] - true_effects).mean((1, 2))
        for part, (before, after) in PARTS.items():
            share = estimate_effects(effects[before] - (effects[after] if after else true_effects), items)
            columns = share[["effect", "ci_low", "ci_high"]].rename(columns={"effect": "share"})
            facts = {"variant": variant, "part": part, "effect": effects[PICTURE].mean((1, 2)), "error": error}
            rows.append(questions(users).assign(**facts).join(columns))
    write_table(out_dir / "mediation.csv", pd.concat(rows, ignore_index=True))


def _by_percept(
    cfg: DictConfig, variant: str, scenes: SceneSet, images: Array, z_theta: Array, told: list[list[Object]],
    kinds: list[Array], job: tuple[str, int],
) -> Float[Array, "percept scene path"]:  # fmt: skip
    """Return one model's P(valid) by picture, by true outlines, and by these with the typical looks of each kind."""
    user, seed = job
    model = load_model(cfg, variant, user, seed, cfg.main_n_demos)
    assert isinstance(model, ClearanceModel)
    pool, seen = train_pool(seed), {symbol: [] for symbol in range(len(SYMBOLS))}
    for i, image in enumerate(scenes.images[pool]):
        scene = scenes.layouts[pool][[i]]
        for symbol, one in zip(scene.symbol[0][scene.present[0]], true_objects(image, scene), strict=True):
            seen[int(symbol)].append(one)
    typical = {
        symbol: {name: np.mean([getattr(one, name) for one in alike], axis=0) for name in ("features", "looks")}
        for symbol, alike in seen.items()
        if alike
    }
    named = [
        [one._replace(**typical.get(int(symbol), {})) for one, symbol in zip(*scene, strict=True)]
        for scene in zip(told, kinds, strict=True)
    ]
    sure = [0.0] * len(told)
    percepts = images, *(Objects.of(objects, sure, kinds=model.kinds) for objects in (told, named))
    return np.stack([model.probability(percept, z_theta) for percept in percepts])


def ask_on_support(cfg: DictConfig, scenes: SceneSet, out_dir: Path) -> None:
    """Write support.csv: right verdicts and the largest error of an effect by number of items and by distance.

    Training scenes have at most max(items_per_scene) items; with one added, a scene may have more. distance: from the
    scenes with an added item to the nearest training layout (`layout_distance`), mean over seeds, below its median or
    not. scenes: of all questions, the share that are asked there.
    """
    pool, users, seeds = cfg.protocol.splits[cfg.intervene.split], list(cfg.evaluate.users), list(cfg.protocol.seeds)
    added = read_interventions(Path(cfg.paths.intervene), scenes.layouts[pool])
    effects = read_table(Path(cfg.paths.intervene) / "effects.parquet")
    effects, most = effects[effects["scene"] < len(scenes.layouts[pool])], max(cfg.scenes.layout.items_per_scene)
    training = [scenes.layouts[train_pool(seed)] for seed in seeds]
    distance = np.stack([np.mean([layout_distance(x, t) for t in training], axis=0) for x in added.layouts])
    items = np.stack([x.present.sum(1) for x in added.layouts])  # (symbol, scene)
    middle = np.median(distance)
    groups: dict[str, Bool[Array, "symbol scene"]] = {f"{n} items": items == n for n in np.unique(items).tolist()}
    groups |= {"near a training layout": distance < middle, "far from every one": distance >= middle}
    rows = []
    for variant, group in product(map(str, cfg.variants), groups):
        where, judged = groups[group], []
        for user, (k, symbol) in product(users, enumerate(SYMBOLS)):
            chosen = effects.query("variant == @variant and user == @user and question == @asked", local_dict={
                "variant": variant, "user": user, "asked": f"add_{symbol}"})  # fmt: skip
            if where[k].sum() < 2 or chosen.empty:
                continue
            table = chosen.pivot(index="seed", columns="scene", values=["effect", "true_effect"])
            made, true = (table[name].to_numpy()[:, where[k]] for name in ("effect", "true_effect"))
            judged.append(compare_with_truth(0 * made[None], made[None], 0 * true[:1], true[:1]))
        if judged:
            answers = pd.concat(judged)
            error = float((answers["effect"] - answers["truth"]).abs().max())
            facts = {"variant": variant, "group": group, "outside": bool((items[where] > most).all())}
            share = {"scenes": float(where.mean()), "asked": len(answers), "right": float(answers["right"].sum())}
            rows.append(facts | share | {"largest_error": error})
    write_table(out_dir / "support.parquet", pd.DataFrame(rows))


def layout_distance(scenes: Layouts, training: Layouts) -> Float[Array, " scene"]:
    """Return how far each layout is from the nearest training layout [m].

    Two layouts are as far apart as the item of the first that is furthest from an item of its kind in the second; an
    item of a kind that is missing there counts as NO_SUCH_KIND_M away.
    """
    apart = np.linalg.norm(scenes.centre[:, None, :, None] - training.centre[None, :, None], axis=-1)
    alike = (scenes.symbol[:, None, :, None] == training.symbol[None, :, None]) & training.present[None, :, None]
    nearest = np.where(alike, apart, NO_SUCH_KIND_M).min(-1)  # (scene, training scene, slot)
    return np.where(scenes.present[:, None], nearest, 0.0).max(-1).min(1)
