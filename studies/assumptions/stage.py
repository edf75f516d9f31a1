"""Stage assumptions: break what must hold for a model's effects to be the user's, more and more, and ask again.

Each attempt breaks one assumption at growing doses (conf/studies/assumptions.yaml): pictures and percepts of fitted
models are spoilt, models are fitted to worse demonstrations or where association misleads, or questions are asked ever
further from training. At each dose the effects of added items are judged as in stage intervene.
"""

from collections.abc import Mapping
from dataclasses import fields, replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig

from making.render.read import read_rendered
from pipeline.artifacts.files import read_table, write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, Versions, read_interventions, read_scenes, read_versions, train_pool
from pipeline.causal.interventions import added_items, compare_with_truth, verdicts
from pipeline.launch import launch
from pipeline.models.base import to_tensor
from pipeline.models.clearance.clearance import ClearanceModel
from pipeline.models.trained import check_weights, load_model
from pipeline.perception.objects import Objects, detect_objects
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Several, Shares, Strengths, StudyGroup, Whole, need
from pipeline.runtime.streams import stream
from pipeline.training.refit import TrainingSet, demonstrations, refit_and_predict
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts, segment_distance
from pipeline.world.rules import clearance, slack, valid
from studies.assumptions.origin import mediate
from studies.assumptions.world import GLASS, World, association, association_strength, draw_scenes

FADED, MISSED, MISTAKEN = "faded", "missed", "mistaken"  # attempts, see conf/studies/assumptions.yaml
FLIPPED, UNSHOWN, COMMON_CAUSE = "flipped", "unshown", "common cause"
ITEMS, DISTANCE, GAP = "items", "distance", "gap"
ORDINARY, CONTROL, CONFOUNDED = "ordinary", "control", "confounded"  # worlds: of stage scenes; without, with
COLUMNS = ["user", "symbol", "effect", "ci_low", "ci_high", "verdict", "truth", "truth_verdict", "right"]
CANDIDATES = 20  # random paths for each demonstration that is to keep away from the boundary of validity
QUANTILES = 0.0, 0.5, 0.75  # of the distance to training: questions asked at least so far away
NO_SUCH_KIND_M = 1.0  # distance to an item of a kind that a training scene does not have
SHOWN = 5  # training scenes of each world whose images are kept
Predicted = dict[tuple[str, float], Float[Array, "seed version scene path"]]  # by attempt and dose


class Settings(StudyGroup):
    root_seed: Whole
    scenes: Several
    mediated: Several
    rendered: str
    faded: Shares
    missed: Shares
    mistaken: Shares
    flipped: Shares
    unshown_m: Strengths
    gap_m: Strengths
    world: World


def agree(study: Settings, parameters: Any) -> None:
    """Require room for plates and glasses, and the doses 0 and p_common_cause."""
    name, laid, world = "studies.assumptions", parameters.scenes.layout, study.world
    lengths = f"two lengths from scenes.layout.clear_of_items = {laid.clear_of_items} on, the smaller first [m]"
    need(laid.clear_of_items <= world.gap_m[0] <= world.gap_m[1], f"{name}.world.gap_m", world.gap_m, lengths)
    room = laid.slots - max(laid.items_per_scene) + 1
    doses = f"doses with 0, the control, and p_common_cause = {world.p_common_cause}"
    need({0.0, world.p_common_cause} <= set(world.doses), f"{name}.world.doses", world.doses, doses)
    few = f"a whole number from 1 to {room} (layout.slots)"
    need(world.glasses <= room, f"{name}.world.glasses", world.glasses, few)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write doses.csv (each question at each dose), right.parquet, ledger.csv and mediation.csv."""
    check_weights(cfg)
    study, pool = cfg.studies.assumptions, cfg.protocol.splits[cfg.intervene.split]
    scenes = read_scenes(Path(cfg.paths.scenes))
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    asked, ordinary = read_versions(cfg, scenes, study.scenes), demonstrations(cfg, scenes)
    parts = spoil_percepts(cfg, asked) + spoil_demonstrations(cfg, scenes, asked, ordinary)
    parts += confound(cfg, scenes, asked, ordinary, out_dir) + ask_far_from_training(cfg, scenes)
    doses = pd.concat(parts, ignore_index=True)
    write_table(out_dir / "doses.csv", doses)
    write_table(out_dir / "right.parquet", right_verdicts(doses))
    write_table(out_dir / "ledger.csv", ledger(doses, cfg.evaluate.users[-1]))
    traced = rendered_versions(Path(study.rendered), study.mediated, study.root_seed, asked.z_theta.shape[1])
    sources = {"drawn": read_versions(cfg, scenes, study.mediated), "path-traced": traced}
    shares = [mediate(cfg, see_items(cfg), scenes, x).assign(source=source) for source, x in sources.items()]
    write_table(out_dir / "mediation.csv", pd.concat(shares, ignore_index=True))


def rendered_versions(folder: Path, count: int, root_seed: int, paths: int) -> Versions:
    """Return the first path-traced tables without and with an added item, with random paths in them."""
    rendered = read_rendered(folder)
    images = np.stack([rendered.images, *rendered.with_item.values()])[:, :count]
    layouts = [x[:count] for x in (rendered.layouts, *rendered.layouts_with_item.values())]
    return Versions(images, layouts, random_z_theta(stream(root_seed, "paths"), images.shape[1], paths))


def see_items(cfg: DictConfig) -> list[str]:
    """Return the compared variants that see items: the paper's model has no effect that could break."""
    return [str(name) for name, v in cfg.variants.items() if v.compared and v.stage in ("irl", "clearance")]


def judged(
    cfg: DictConfig, attempt: str, dose: float, variant: str, p: Float[Array, "user seed version scene path"],
    asked: Versions,
) -> pd.DataFrame:  # fmt: skip
    """Return the verdicts on all questions about added items, with attempt, dose and variant."""
    users = list(cfg.evaluate.users)
    truth = np.stack([[valid(x, asked.z_theta, cfg.users[user]) for x in asked.layouts] for user in users])
    rows = verdicts(users, p, truth, asked.layouts)[COLUMNS]
    return rows.assign(attempt=attempt, dose=float(dose), variant=variant, share=1.0)


def fit_and_predict(
    cfg: DictConfig, training_sets: dict[str, list[TrainingSet]], asked: Versions, desc: str
) -> dict[str, Float[Array, "dose user seed version scene path"]]:
    """Fit every variant to its training sets, by dose, user and seed; return P(valid) of every path."""
    images, z_theta = np.concatenate(asked.images), np.tile(asked.z_theta, (len(asked.images), 1, 1))
    p = refit_and_predict(cfg, training_sets, images, z_theta, desc)
    shape = len(cfg.evaluate.users), len(cfg.protocol.seeds), *asked.images.shape[:2], z_theta.shape[1]
    return {variant: x.reshape(-1, *shape) for variant, x in p.items()}


# Pictures and percepts of fitted models


def spoil_percepts(cfg: DictConfig, asked: Versions) -> list[pd.DataFrame]:
    """Judge models where added items fade, or items are missed or mistaken; dose 0 also stands for demonstrations."""
    jobs = [(variant, str(user)) for variant in see_items(cfg) for user in cfg.evaluate.users]
    answers = dict(zip(jobs, map_jobs(partial(_answer, cfg, asked), jobs, cfg.workers, "percepts"), strict=True))
    parts = []
    for variant in see_items(cfg):
        by_user = [answers[variant, user] for user in cfg.evaluate.users]
        for attempt, dose in by_user[0]:
            p = np.stack([of_user[attempt, dose] for of_user in by_user])
            parts.append(judged(cfg, attempt, dose, variant, p, asked))
    return parts


def _answer(cfg: DictConfig, asked: Versions, job: tuple[str, str]) -> Predicted:
    """Return P(valid) by one user's models of a variant, at every dose of the attempts that suit it."""
    (variant, user), study = job, cfg.studies.assumptions
    models = [load_model(cfg, variant, user, seed, cfg.main_n_demos) for seed in cfg.protocol.seeds]
    pictures, z_theta = np.concatenate(asked.images), np.tile(asked.z_theta, (len(asked.images), 1, 1))
    added, attempts = asked.images - asked.images[:1].astype(float), [FADED]
    seen: dict[tuple[str, float], Any] = {}
    for share in study.faded:
        faded = np.round(asked.images[:1] + (1 - share) * added).astype(np.uint8)
        seen[FADED, share] = np.concatenate(faded)
    if isinstance(models[0], ClearanceModel):
        attempts += [MISSED, MISTAKEN, FLIPPED, UNSHOWN]
        found = detect_objects(to_tensor(pictures), looks=models[0].kinds > 0)
        for name, spoil in ((MISSED, miss), (MISTAKEN, mistake)):
            for share in study[name]:
                seen[name, share] = spoil(stream(study.root_seed, name), found, share)

    def probability(x: Any) -> Float[Array, "seed version scene path"]:
        p = np.stack([model.probability(x, z_theta) for model in models])
        return p.reshape(len(models), *asked.images.shape[:2], -1)

    undisturbed = probability(pictures)
    return {(name, 0.0): undisturbed for name in attempts} | {key: probability(x) for key, x in seen.items()}


def miss(rng: np.random.Generator, objects: Objects, share: float) -> Objects:
    """Return the objects, in the first slots, without a random share of them."""
    present = objects.present & (rng.uniform(size=objects.present.shape) >= share)
    order = np.arange(len(objects))[:, None], np.argsort(~present, axis=1, kind="stable")
    kept = {f.name: getattr(objects, f.name)[order] for f in fields(objects) if f.name != "doubt"}
    return replace(objects, **kept | {"present": present[order]})


def mistake(rng: np.random.Generator, objects: Objects, share: float) -> Objects:
    """Return the objects, of which a random share has the features of another one, of any scene."""
    where = np.argwhere(objects.present)
    others, chosen = rng.permutation(where), rng.uniform(size=len(where)) < share
    to, of = tuple(where[chosen].T), tuple(others[chosen].T)
    features, kinds = objects.features.copy(), objects.kinds.copy()
    features[to], kinds[to] = objects.features[of], objects.kinds[of]
    return replace(objects, features=features, kinds=kinds)


# Demonstrations


def spoil_demonstrations(
    cfg: DictConfig, scenes: SceneSet, asked: Versions, ordinary: list[TrainingSet]
) -> list[pd.DataFrame]:
    """Judge models of stage clearance that are fitted to flipped labels, or to paths away from every boundary."""
    study, sets = cfg.studies.assumptions, dict[tuple[str, float], list[TrainingSet]]()
    for share in study.flipped:
        streams = [stream(study.root_seed, FLIPPED, t.user, t.seed) for t in ordinary]
        flips = [rng.uniform(size=t.valid.shape) < share for rng, t in zip(streams, ordinary, strict=True)]
        sets[FLIPPED, share] = [replace(t, valid=t.valid ^ x) for t, x in zip(ordinary, flips, strict=True)]
    for gap in study.unshown_m:
        sets[UNSHOWN, gap] = [_away_from_boundary(cfg, scenes.layouts[train_pool(t.seed)], t, gap) for t in ordinary]
    variants = [name for name in see_items(cfg) if cfg.variants[name].stage == "clearance"]
    every = [t for of_dose in sets.values() for t in of_dose]
    fitted = fit_and_predict(cfg, dict.fromkeys(variants, every), asked, "worse demonstrations")
    return [judged(cfg, *key, v, p, asked) for v in variants for key, p in zip(sets, fitted[v], strict=True)]


def _away_from_boundary(cfg: DictConfig, layouts: Layouts, t: TrainingSet, gap: float) -> TrainingSet:
    """Return random demonstrations whose clearance differs from the user's margins by at least `gap` [m]."""
    margins, count = cfg.users[t.user], t.z_theta.shape[1]
    rng = stream(cfg.studies.assumptions.root_seed, UNSHOWN, t.user, t.seed)
    z_theta = random_z_theta(rng, len(layouts), CANDIDATES * count)
    near = abs(slack(layouts, clearance(layouts, z_theta), margins)) < gap
    first = np.argsort(near, axis=1, kind="stable")[:, :count, None]
    z_theta = np.take_along_axis(z_theta, first, axis=1)
    return replace(t, z_theta=z_theta, valid=valid(layouts, z_theta, margins))


# The confounded world


def confound(
    cfg: DictConfig, scenes: SceneSet, asked: Versions, ordinary: list[TrainingSet], out_dir: Path
) -> list[pd.DataFrame]:
    """Judge models fitted in worlds that differ in `p_common_cause`; write association.csv and worlds.npz.

    Compared variants that see items are fitted at every dose, all others in control and confounded world. worlds.npz:
    images of training scenes of these two.
    """
    world, users, seeds = cfg.studies.assumptions.world, list(cfg.evaluate.users), list(cfg.protocol.seeds)
    names = {dose: {0.0: CONTROL, world.p_common_cause: CONFOUNDED}.get(dose, f"p={dose}") for dose in world.doses}
    keys = list(product(world.doses, seeds))
    drawn = dict(zip(keys, map_jobs(partial(draw_scenes, cfg), keys, cfg.workers, "confounded scenes"), strict=True))
    training_sets: dict[str, list[TrainingSet]] = {ORDINARY: ordinary} | {name: [] for name in names.values()}
    for dose, user, seed in product(world.doses, users, seeds):
        laid, pictures = drawn[dose, seed]
        paths = random_z_theta(stream(world.root_seed, "paths", user, seed), len(laid), cfg.main_n_demos)
        labelled = TrainingSet(user, seed, pictures, paths, valid(laid, paths, cfg.users[user]))
        training_sets[names[dose]].append(labelled)
    laid_out: dict[tuple[str, int], Layouts] = {(names[dose], seed): laid for (dose, seed), (laid, _) in drawn.items()}
    laid_out |= {(ORDINARY, seed): scenes.layouts[train_pool(seed)] for seed in seeds}
    write_table(out_dir / "association.csv", pd.DataFrame(associations(cfg, training_sets, laid_out)))
    shown = {CONTROL: 0.0, CONFOUNDED: world.p_common_cause}
    write_arrays(out_dir / "worlds.npz", {x: drawn[dose, seeds[0]][1][:SHOWN] for x, dose in shown.items()})

    two = [0.0, world.p_common_cause]
    fitted_in = {v: list(names) if v in see_items(cfg) else two for v in map(str, cfg.variants)}
    sets = {v: [t for dose in doses for t in training_sets[names[dose]]] for v, doses in fitted_in.items()}
    fitted = fit_and_predict(cfg, sets, asked, "confounded world")
    return [
        judged(cfg, COMMON_CAUSE, dose, variant, p, asked)
        for variant, doses in fitted_in.items()
        for dose, p in zip(doses, fitted[variant], strict=True)
    ]


def associations(
    cfg: DictConfig, training_sets: Mapping[str, list[TrainingSet]], laid_out: Mapping[tuple[str, int], Layouts]
) -> list[dict[str, Any]]:
    """Return how invalid paths go with passing near each kind of item, by world and user."""
    rows = []
    for name, user in product(training_sets, cfg.evaluate.users):
        sets, near = [t for t in training_sets[name] if t.user == user], {}
        for symbol in range(len(SYMBOLS)):
            passing = []
            for t in sets:
                laid = laid_out[name, t.seed]
                is_near = clearance(laid, t.z_theta) < cfg.studies.assumptions.world.near_m  # (scene, path, slot)
                passing.append((is_near & (laid.symbol == symbol)[:, None]).any(-1))
            near[symbol] = np.concatenate(passing)
        invalid = ~np.concatenate([t.valid for t in sets])
        for symbol, passing in near.items():
            row = association(invalid, passing) | association_strength(invalid, passing, near[GLASS])
            matters = cfg.users[user][SYMBOLS[symbol]] is not None
            rows.append({"world": name, "user": user, "symbol": SYMBOLS[symbol], "matters": matters} | row)
    return rows


# Questions far from training


def ask_far_from_training(cfg: DictConfig, scenes: SceneSet) -> list[pd.DataFrame]:
    """Judge stage intervene's effects on tables with more items, further from training, and with closer items.

    Dose of `items`: their number with the added one. Of `distance`: the least one from a training layout
    (`layout_distance`, mean over seeds). Of `gap`: the largest between the added item and its neighbour, falling.
    share: of all questions, those asked there.
    """
    pool, seeds = cfg.protocol.splits[cfg.intervene.split], list(cfg.protocol.seeds)
    added = read_interventions(Path(cfg.paths.intervene), scenes.layouts[pool])
    effects = read_table(Path(cfg.paths.intervene) / "effects.parquet")
    effects = effects[effects["scene"] < len(scenes.layouts[pool])]
    held = added_items([scenes.layouts[pool], *added.layouts])  # (symbol, scene, item)
    training = [scenes.layouts[train_pool(seed)] for seed in seeds]
    distance = np.stack([np.mean([layout_distance(x, t) for t in training], axis=0) for x in added.layouts])
    items, gap = np.stack([x.present.sum(1) for x in added.layouts]), np.stack([*map(added_gap, added.layouts)])
    groups: list[tuple[str, float, Array]] = [(ITEMS, n, items == n) for n in np.unique(items).tolist()]
    groups += [(DISTANCE, d, distance >= d) for d in np.quantile(distance, QUANTILES).tolist()]
    groups += [(GAP, most, gap <= most) for most in reversed(cfg.studies.assumptions.gap_m)]
    parts = []
    for variant, user in product(cfg.variants, cfg.evaluate.users):
        for (attempt, dose, where), (k, symbol) in product(groups, enumerate(SYMBOLS)):
            keys = {"variant": str(variant), "user": str(user), "question": f"add_{symbol}"}
            chosen = effects[(effects[list(keys)] == list(keys.values())).all(axis=1)]
            if where[k].sum() < 2 or chosen.empty:
                continue
            table = chosen.pivot(index="seed", columns="scene", values=["effect", "true_effect"])
            made, true = (table[name].to_numpy()[:, where[k]] for name in ("effect", "true_effect"))
            rows = compare_with_truth(0 * made[None], made[None], 0 * true[:1], true[:1], held[[k]][:, where[k]])
            facts = {"attempt": attempt, "dose": float(dose), "variant": str(variant), "share": float(where.mean())}
            parts.append(rows.assign(user=user, symbol=symbol)[COLUMNS].assign(**facts))
    return parts


def added_gap(layouts: Layouts) -> Float[Array, " scene"]:
    """Return the gap [m] between each scene's last item and the one nearest to it; infinite if it stands alone."""
    rows, last = np.arange(len(layouts)), layouts.present.sum(1) - 1
    ends, radius = layouts.ends[rows, last], layouts.radius[rows, last]
    gap = segment_distance(layouts.ends, ends[:, None]) - layouts.radius - radius[:, None]
    others = layouts.present & (np.arange(layouts.present.shape[1]) != last[:, None])
    return np.where(others, gap, np.inf).min(1)


def layout_distance(scenes: Layouts, training: Layouts) -> Float[Array, " scene"]:
    """Return how far each layout is from the nearest training layout [m].

    Two layouts are as far apart as the item of the first that is furthest from an item of its kind in the second; an
    item of a kind that is missing there counts as NO_SUCH_KIND_M away.
    """
    apart = np.linalg.norm(scenes.centre[:, None, :, None] - training.centre[None, :, None], axis=-1)
    alike = (scenes.symbol[:, None, :, None] == training.symbol[None, :, None]) & training.present[None, :, None]
    nearest = np.where(alike, apart, NO_SUCH_KIND_M).min(-1)  # (scene, training scene, slot)
    return np.where(scenes.present[:, None], nearest, 0.0).max(-1).min(1)


# What flips


def right_verdicts(doses: pd.DataFrame) -> pd.DataFrame:
    """Return the number of right verdicts and the largest error of an effect, by attempt, variant and dose."""
    table = doses.assign(error=(doses["effect"] - doses["truth"]).abs(), right=doses["right"].astype(float))
    groups = table.groupby(["attempt", "variant", "dose", "share"], sort=False)
    return groups.agg(right=("right", "sum"), asked=("right", "size"), largest_error=("error", "max")).reset_index()


def ledger(doses: pd.DataFrame, user: str) -> pd.DataFrame:
    """Return, by attempt and variant, the first dose at which a verdict that was right is wrong (missing: none).

    claim: `glass`, that glasses matter to `user`, or `all` questions. weakest, strongest: the doses tried, in their
    order; right_weakest, right_strongest: right verdicts there.
    """
    rows = []
    for (attempt, variant), table in doses.groupby(["attempt", "variant"], sort=False):
        glass = table[(table["user"] == user) & (table["symbol"] == SYMBOLS[GLASS])]
        for claim, asked in {"glass": glass, "all": table}.items():
            tried = asked["dose"].drop_duplicates().tolist()
            right = asked.pivot(index=["user", "symbol"], columns="dose", values="right")[tried].astype(float)
            flipped = right.lt(right.iloc[:, 0], axis=0).any()
            facts = {"attempt": attempt, "variant": variant, "claim": claim, "asked": len(right)}
            facts |= {"weakest": tried[0], "strongest": tried[-1]}
            facts["flips_at"] = flipped.idxmax() if flipped.any() else None
            counts = {"right_weakest": right.iloc[:, 0].sum(), "right_strongest": right.iloc[:, -1].sum()}
            rows.append(facts | counts)
    return pd.DataFrame(rows)


if __name__ == "__main__":
    launch(main, "assumptions")
