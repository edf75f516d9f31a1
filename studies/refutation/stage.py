"""Stage refutation: ask models questions with a known true answer, and fit them where association misleads.

Refuters (pipeline.causal.refuters) change images, labels or scenes so that the true answer is known. In the confounded
world glasses stand next to plates, so that plates are associated with invalid paths without any effect.
"""

from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig, OmegaConf
from pydantic import AfterValidator, Field
from scipy.stats import t as student

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import AddedItems, SceneSet, Versions, read_scenes, read_versions, train_pool
from pipeline.causal import refuters
from pipeline.causal.interventions import added_item_effects, added_items, estimate_effects, questions, verdicts
from pipeline.launch import launch
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime import settings
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, Counts, Group, Length, Pair, Several, Share, StudyGroup, Whole, need
from pipeline.runtime.streams import stream
from pipeline.stats.tests import LEVEL
from pipeline.training.refit import TrainingSet, demonstrations, refit_and_predict
from pipeline.world import layout
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, Items, LayoutRules, Layouts
from pipeline.world.render import ImageSource, Palette, read_palette, render_scenes
from pipeline.world.rules import clearance, valid
from studies.refutation.origin import ask_on_support, ask_where_errors_arise

Images = UInt8[Array, "version scene 100 100 3"]  # version 0 is the original scene, 1 + k has symbol k added
Effects = Float[Array, "question seed scene"]
NEGLIGIBLE = "negligible"  # expected verdict of every refuter except data_subset
COLUMNS = ["refuter", "setting", "variant", "user", "symbol", "effect", "ci_low", "ci_high", "p_holm", "verdict",
           "expected", "passed", "agreement"]  # fmt: skip
ORDINARY, CONTROL, CONFOUNDED = "ordinary", "control", "confounded"  # worlds: of stage scenes; without, with
GLASS, PLATE = SYMBOLS.index("glass"), SYMBOLS.index("plate")  # a common cause of plates and glasses
OTHERS = [symbol for symbol in range(len(SYMBOLS)) if symbol not in (GLASS, PLATE)]
GAP_TOLERANCE_M = 1e-6  # accepted error of a gap between plate and glass
SHOWN = 5  # training scenes of each world whose images are kept


class World(Group):
    """Plates and glasses of the confounded world, and of its control."""

    root_seed: Whole
    scenes: Several
    p_common_cause: settings.Chance
    doses: Annotated[list[settings.Chance], Field(min_length=2), AfterValidator(settings.rising)]
    gap_m: Pair
    present: Share
    glasses: Count
    near_m: Length


class Settings(StudyGroup):
    root_seed: Whole
    scenes: Annotated[int, Field(ge=4)]  # data_subset halves them
    pieces: Counts
    far_m: Length
    textures: str
    halves: Several
    world: World


def agree(study: Settings, parameters: Any) -> None:
    """Require pieces that tile an image, `far_m` beyond every margin, and room for plates and glasses."""
    name, laid, world = "studies.refutation", parameters.scenes.layout, study.world
    tiles = all(SIDE % piece == 0 for piece in study.pieces)
    need(tiles, f"{name}.pieces", study.pieces, f"numbers that divide {SIDE}, an image's side [px]")
    widest = settings.widest_margin(parameters.users) or 0.0
    need(study.far_m > widest, f"{name}.far_m", study.far_m, f"more than the widest margin in users, {widest} m")
    lengths = f"two lengths from scenes.layout.clear_of_items = {laid.clear_of_items} on, the smaller first [m]"
    need(laid.clear_of_items <= world.gap_m[0] <= world.gap_m[1], f"{name}.world.gap_m", world.gap_m, lengths)
    room = laid.slots - max(laid.items_per_scene) + 1
    doses = f"doses with 0, the control, and p_common_cause = {world.p_common_cause}"
    need({0.0, world.p_common_cause} <= set(world.doses), f"{name}.world.doses", world.doses, doses)
    few = f"a whole number from 1 to {room} (layout.slots)"
    need(world.glasses <= room, f"{name}.world.glasses", world.glasses, few)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Ask fitted models what refuters ask and where their errors arise, then models of the confounded world."""
    check_weights(cfg)
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    ordinary = demonstrations(cfg, scenes)
    asked = read_versions(cfg, scenes, cfg.studies.refutation.scenes)
    ask_refuters(cfg, asked, ordinary, out_dir)
    ask_where_errors_arise(cfg, scenes, asked, out_dir)
    ask_on_support(cfg, scenes, out_dir)
    ask_in_confounded_world(cfg, scenes, ordinary, out_dir)


# Refuters


def ask_refuters(cfg: DictConfig, asked: Versions, ordinary: list[TrainingSet], out_dir: Path) -> None:
    """Write summary.csv, passed.parquet, and examples.npz: each placebo patch in the first scene, by symbol."""
    study, users, seeds = cfg.studies.refutation, list(cfg.evaluate.users), list(cfg.protocol.seeds)
    images, layouts, z_theta = asked
    placed = AddedItems(images[1:], layouts[1:]).placed
    far = np.stack([clearance(item, z_theta)[..., 0] > study.far_m for item in placed])  # (symbol, scene, path)
    far_scenes = far.any(-1).all(0)  # (scene,)
    items = np.tile(added_items(layouts), (len(users), 1, 1))
    if far_scenes.sum() < 2:
        expected = "a length that paths of at least two scenes keep from each added item; lower it"
        raise InputError(f"studies.refutation.far_m is {study.far_m}: expected {expected}")

    # Each set of images is predicted once; a refuter compares versions of one or two sets.
    patches = {}
    for piece in study.pieces:
        rng = stream(study.root_seed, "placebo", piece)
        patched = [refuters.placebo_patch(rng, images[0], with_item, piece) for with_item in images[1:]]
        patches[f"piece={piece}"] = np.stack([images[0], *patched])
    elsewhere = {f"texture={name}": x for name, x in render_elsewhere(cfg, layouts).items()}
    image_sets = np.stack([images, *patches.values(), *elsewhere.values()])  # (set, version, scene, ...)
    flat_images = image_sets.reshape(-1, *images.shape[2:])
    repeated = np.tile(z_theta, (len(flat_images) // len(z_theta), 1, 1))
    p_by_variant = predict_all(cfg, users, flat_images, repeated, "refutation")

    permuted = []
    for t in ordinary:
        labels = stream(study.root_seed, "permuted", t.user, t.seed).permutation(t.valid.ravel())
        permuted.append(replace(t, valid=labels.reshape(t.valid.shape)))
    compared = [name for name, variant in cfg.variants.items() if variant.compared]
    p_permuted = fit_and_predict(cfg, dict.fromkeys(compared, permuted), asked, "permuted labels")

    summary = []
    for variant, p in p_by_variant.items():
        p = p.reshape(len(users), len(seeds), *image_sets.shape[:3], -1)  # (user, seed, set, version, scene, path)
        item_effects, *others = (added_item_effects(p[:, :, i]) for i in range(len(image_sets)))
        near_nothing = refuters.mean_over_paths(p[:, :, 0, 1:], far) - refuters.mean_over_paths(p[:, :, 0, :1], far)
        control_effects = np.moveaxis(near_nothing[..., far_scenes], 2, 1).reshape(len(item_effects), len(seeds), -1)
        by_refuter: dict[tuple[str, str], Effects] = {}
        if variant in p_permuted:
            by_refuter[refuters.DUMMY_OUTCOME, "permuted labels"] = added_item_effects(p_permuted[variant][0])
        by_refuter |= {(refuters.PLACEBO_TREATMENT, x): e for x, e in zip(patches, others, strict=False)}
        by_refuter[refuters.NEGATIVE_CONTROL, f"far_m={study.far_m}"] = control_effects
        for texture, effects in zip(elsewhere, others[len(patches) :], strict=True):
            by_refuter[refuters.OTHER_ENVIRONMENT, texture] = effects - item_effects
        judged = {}
        for key, effects in by_refuter.items():
            held = items[:, far_scenes] if key[0] == refuters.NEGATIVE_CONTROL else items
            judged[key] = estimate_effects(effects, held).assign(expected=NEGLIGIBLE)
        halves = refuters.data_subset(stream(study.root_seed, "halves", variant), item_effects, study.halves)
        for (refuter, setting), rows in {**judged, (refuters.DATA_SUBSET, f"halves={study.halves}"): halves}.items():
            facts = {"refuter": refuter, "setting": setting, "variant": variant}
            rows = rows.assign(**facts, passed=rows["verdict"] == rows["expected"])
            summary.append(pd.concat([questions(users), rows], axis=1).reindex(columns=COLUMNS))
    table = pd.concat(summary, ignore_index=True)
    passed = table.groupby(["refuter", "setting", "variant"], sort=False)["passed"].agg(passed="sum", asked="size")
    write_table(out_dir / "summary.csv", table)
    write_table(out_dir / "passed.parquet", passed.astype({"passed": float}).reset_index())
    write_arrays(out_dir / "examples.npz", {setting: x[1:, 0] for setting, x in patches.items()})


def render_elsewhere(cfg: DictConfig, layouts: list[Layouts]) -> dict[str, Images]:
    """Return texture -> the scenes without and with each added item on that table top, under another light."""
    study, catalogue = cfg.studies.refutation, read_catalogue(Path(cfg.paths.data))
    textures, palette = catalogue.texture_names(study.textures), Palette(catalogue, ImageSource.of(cfg.scenes.source))
    if not textures:
        splits = ", ".join(sorted(set(catalogue.textures["split"])))
        raise InputError(f"studies.refutation.textures is {study.textures!r}: expected one of {splits}")
    seeds = stream(study.root_seed, "lights").integers(2**31, size=len(layouts[0])).tolist()
    return {t: np.stack([render_scenes(x, [t] * len(x), seeds, palette) for x in layouts]) for t in textures}


def fit_and_predict(
    cfg: DictConfig, training_sets: dict[str, list[TrainingSet]], asked: Versions, desc: str
) -> dict[str, Float[Array, "world user seed version scene path"]]:
    """Fit every variant to its training sets, by world, user and seed; return P(valid) of every path."""
    images, z_theta = np.concatenate(asked.images), np.tile(asked.z_theta, (len(asked.images), 1, 1))
    p = refit_and_predict(cfg, training_sets, images, z_theta, desc)
    shape = len(cfg.evaluate.users), len(cfg.protocol.seeds), *asked.images.shape[:2], z_theta.shape[1]
    return {variant: x.reshape(-1, *shape) for variant, x in p.items()}


# The confounded world


def ask_in_confounded_world(cfg: DictConfig, scenes: SceneSet, ordinary: list[TrainingSet], out_dir: Path) -> None:
    """Write association.csv, effects.csv, tipping.parquet and worlds.npz: images of training scenes of two worlds.

    Models are fitted in worlds that differ in `p_common_cause` (the dose); the effects of items added to ordinary
    scenes are then estimated as in stage intervene. Compared variants that see items are fitted at every dose, all
    others in control and confounded world.
    """
    world, users, seeds = cfg.studies.refutation.world, list(cfg.evaluate.users), list(cfg.protocol.seeds)
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

    associations = []
    for name, user in product(training_sets, users):
        sets, near = [t for t in training_sets[name] if t.user == user], {}
        for symbol in range(len(SYMBOLS)):
            passing = []
            for t in sets:
                laid = laid_out[name, t.seed]
                is_near = clearance(laid, t.z_theta) < world.near_m  # (scene, path, slot)
                passing.append((is_near & (laid.symbol == symbol)[:, None]).any(-1))
            near[symbol] = np.concatenate(passing)
        invalid = ~np.concatenate([t.valid for t in sets])
        for symbol, passing in near.items():
            row = association(invalid, passing) | association_strength(invalid, passing, near[GLASS])
            matters = cfg.users[user][SYMBOLS[symbol]] is not None
            associations.append({"world": name, "user": user, "symbol": SYMBOLS[symbol], "matters": matters} | row)

    see_items = [str(name) for name, v in cfg.variants.items() if v.compared and v.stage in ("irl", "clearance")]
    fitted_in = {v: list(names) if v in see_items else [0.0, world.p_common_cause] for v in map(str, cfg.variants)}
    sets = {v: [t for dose in doses for t in training_sets[names[dose]]] for v, doses in fitted_in.items()}
    asked, effects, tipping = read_versions(cfg, scenes, world.scenes), [], []
    items = np.tile(added_items(asked.layouts), (len(users), 1, 1))
    truth = np.stack([[valid(x, asked.z_theta, cfg.users[user]) for x in asked.layouts] for user in users])
    for variant, p in fit_and_predict(cfg, sets, asked, "confounded world").items():
        judged = {dose: verdicts(users, x, truth, asked.layouts) for dose, x in zip(fitted_in[variant], p, strict=True)}
        for dose, rows in judged.items():
            plate = rows[(rows["user"] == users[-1]) & (rows["symbol"] == SYMBOLS[PLATE])].iloc[0]
            row = {"variant": variant, "dose": dose, "right": float(rows["right"].sum()), "asked": len(rows)}
            tipping.append(row | plate[["user", "effect", "ci_low", "ci_high", "verdict", "truth"]].to_dict())
        control, confounded = judged[0.0], judged[world.p_common_cause]
        before, after = (added_item_effects(p[fitted_in[variant].index(d)]) for d in (0.0, world.p_common_cause))
        shift = estimate_effects(after - before, items)
        shift = shift[["effect", "ci_low", "ci_high", "p_holm"]].add_prefix("shift_")
        confounded = confounded.join(shift.rename(columns={"shift_effect": "shift"}))
        for name, rows in ((CONTROL, control), (CONFOUNDED, confounded)):
            effects.append(pd.DataFrame({"world": name, "variant": variant}, index=rows.index).join(rows))
    write_table(out_dir / "association.csv", pd.DataFrame(associations))
    write_table(out_dir / "effects.csv", pd.concat(effects, ignore_index=True))
    write_table(out_dir / "tipping.parquet", pd.DataFrame(tipping))
    shown = {CONTROL: 0.0, CONFOUNDED: world.p_common_cause}
    write_arrays(out_dir / "worlds.npz", {x: drawn[dose, seeds[0]][1][:SHOWN] for x, dose in shown.items()})


def association_strength(
    invalid: Bool[Array, "scene path"], near: Bool[Array, "scene path"], cause: Bool[Array, "scene path"]
) -> dict[str, float]:
    """Return `risk_ratio`, P(invalid | near) / P(invalid | not near), its `e_value`, and the cause's `bias_factor`.

    e_value: how strongly, as a risk ratio, a hidden common cause must go with both for it to explain all of the ratio
    (VanderWeele and Ding, 2017, doi 10.7326/M16-2607). bias_factor: the largest ratio that passing near the `cause` can
    explain, by its own two ratios (Ding and VanderWeele, 2016, Epidemiology 27(3), 368-377). Ratios below 1 are
    turned over; what is infinite or undefined is NaN.
    """

    def ratio(outcome: Array, exposed: Array) -> float:
        one, other = (np.float64(outcome[side].mean() if side.any() else np.nan) for side in (exposed, ~exposed))
        with np.errstate(divide="ignore", invalid="ignore"):
            return float(one / other)

    found = ratio(invalid, near)
    found = found if np.isfinite(found) else np.nan
    above = max(found, 1 / found) if found > 0 else np.nan
    with_near, with_invalid = ratio(cause, near), ratio(invalid, cause)
    inverse = 0.0
    if min(with_near, with_invalid) >= 1:  # also of infinite ones
        inverse = 1 / with_near + 1 / with_invalid - 1 / (with_near * with_invalid)
    bias = 1 / inverse if inverse > 0 else np.nan
    return {"risk_ratio": found, "e_value": float(above + np.sqrt(above * (above - 1))), "bias_factor": bias}


def association(invalid: Bool[Array, "scene path"], near: Bool[Array, "scene path"]) -> dict[str, float]:
    """Return `difference`, P(invalid | near) - P(invalid | not near), with its 95 % interval.

    Paths of a scene are dependent, scenes are independent. The standard error is the jackknife's over scenes (Efron and
    Stein, 1981), and the interval is Student's. All is NaN if, without some scene, all paths or none pass near.
    """
    table = np.stack([(x & w).sum(1) for w in (near, ~near) for x in (invalid, np.ones_like(invalid))])
    without = table.sum(1, keepdims=True) - table  # (count, scene): each scene left out in turn
    if (without[[1, 3]] == 0).any():
        return dict.fromkeys(("difference", "ci_low", "ci_high"), np.nan)
    near_rate, far_rate = (float(table[i].sum() / table[i + 1].sum()) for i in (0, 2))
    difference, scenes = near_rate - far_rate, len(invalid)
    jackknife = without[0] / without[1] - without[2] / without[3]
    error = np.sqrt((scenes - 1) / scenes * ((jackknife - jackknife.mean()) ** 2).sum())
    half_width = float(student.ppf(1 - LEVEL / 2, scenes - 1) * error)
    return {"difference": difference, "ci_low": difference - half_width, "ci_high": difference + half_width}


def draw_scenes(cfg: DictConfig, key: tuple[float, int]) -> tuple[Layouts, UInt8[Array, "scene 100 100 3"]]:
    """Draw a seed's training scenes at a dose; textures, lights and cameras do not depend on the dose."""
    (p_common_cause, seed), count = key, cfg.scenes.per_seed
    world = World.model_validate(OmegaConf.to_container(cfg.studies.refutation.world))
    catalogue, palette = read_palette(cfg.paths.data, ImageSource.of(cfg.scenes.source))
    rng, rules = stream(world.root_seed, "scenes", train_pool(seed)), LayoutRules.of(cfg.scenes.layout)
    items = catalogue.footprints, catalogue.pool("train")
    layouts = layout.concatenated([lay_out(r, *items, rules, world, p_common_cause) for r in rng.spawn(count)])
    textures, seeds = rng.choice(catalogue.texture_names("train"), count), rng.integers(2**31, size=count)
    return layouts, render_scenes(layouts, list(textures), seeds.tolist(), palette)


def lay_out(
    rng: np.random.Generator, items: Items, pool: Int[Array, " n"], rules: LayoutRules, world: World, p_common: float
) -> Layouts:
    """Draw one scene with items of `pool` (catalogue rows): a plate, glasses, and bowls and cutlery.

    With probability `p_common` plate and glasses have a common cause: glasses stand beside the plate, or both are
    missing. Else they are drawn independently. The frequency of each symbol does not depend on `p_common`. The
    plate and all glasses together count as one item each of `items_per_scene`. All items are drawn before any is
    placed, even items that turn out not to be needed.
    """
    common_cause = rng.uniform() < p_common
    plate, independent_glasses = (bool(rng.uniform() < world.present) for _ in range(2))
    glasses = plate if common_cause else independent_glasses
    count = max(0, int(rng.choice(rules.items_per_scene)) - plate - glasses)
    others = rng.choice(OTHERS, count).tolist()
    laid = [PLATE] * plate + [GLASS] * (world.glasses * glasses)
    while True:
        scene = layout.empty(1, rules.slots)
        for slot, symbol in enumerate(laid):
            scene = layout.add_item(rng, scene, symbol, items, pool, rules)
            if common_cause and symbol == GLASS and not move_beside_first(rng, scene, slot, rules, world):
                break
        else:
            break
    for symbol in others:
        scene = layout.add_item(rng, scene, symbol, items, pool, rules)
    return scene


def move_beside_first(rng: np.random.Generator, scene: Layouts, slot: int, rules: LayoutRules, world: World) -> bool:
    """Move the item in `slot` along the line to the item in slot 0 until their gap is a random one.

    A step by the excess of the gap never overshoots. Return False if the item then violates a minimum distance or lies
    outside the range of centres.
    """

    def gap_between() -> float:
        return float(layout.segment_distance(*scene.ends[0, [slot, 0]]) - scene.radius[0, slot] - scene.radius[0, 0])

    gap = rng.uniform(world.gap_m[0], world.gap_m[1])
    towards = scene.centre[0, 0] - scene.centre[0, slot]
    towards /= np.linalg.norm(towards)
    while abs(excess := gap_between() - gap) > GAP_TOLERANCE_M:
        scene.centre[0, slot] += excess * towards
    return bool(layout.allowed(scene, np.array([slot]), rules)[0])


if __name__ == "__main__":
    launch(main, "refutation")
