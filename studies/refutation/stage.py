"""Stage refutation: ask models questions with a known true answer.

Refuters (pipeline.causal.refuters) change images, labels or scenes so that the true answer is known.
"""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
from jaxtyping import Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig
from pydantic import Field

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import AddedItems, read_scenes, read_versions, train_pool
from pipeline.causal import refuters
from pipeline.causal.interventions import added_item_effects, added_items, estimate_effects, questions
from pipeline.launch import launch
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime import settings
from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Counts, Length, Several, StudyGroup, Whole, need
from pipeline.runtime.streams import stream
from pipeline.training.refit import demonstrations, refit_and_predict
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, Layouts
from pipeline.world.render import ImageSource, Palette, render_scenes
from pipeline.world.rules import clearance

Images = UInt8[Array, "version scene 100 100 3"]  # version 0 is the original scene, 1 + k has symbol k added
Effects = Float[Array, "question seed scene"]
NEGLIGIBLE = "negligible"  # expected verdict of every refuter except data_subset
COLUMNS = ["refuter", "setting", "variant", "user", "symbol", "effect", "ci_low", "ci_high", "p_holm", "verdict",
           "expected", "passed", "agreement"]  # fmt: skip


class Settings(StudyGroup):
    root_seed: Whole
    scenes: Annotated[int, Field(ge=4)]  # data_subset halves them
    pieces: Counts
    far_m: Length
    textures: str
    halves: Several


def agree(study: Settings, parameters: Any) -> None:
    """Require pieces that tile an image, and `far_m` beyond every margin."""
    name = "studies.refutation"
    tiles = all(SIDE % piece == 0 for piece in study.pieces)
    need(tiles, f"{name}.pieces", study.pieces, f"numbers that divide {SIDE}, an image's side [px]")
    widest = settings.widest_margin(parameters.users) or 0.0
    need(study.far_m > widest, f"{name}.far_m", study.far_m, f"more than the widest margin in users, {widest} m")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write summary.csv, passed.parquet, and examples.npz: each placebo patch in the first scene, by symbol."""
    check_weights(cfg)
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    study, users, seeds = cfg.studies.refutation, list(cfg.evaluate.users), list(cfg.protocol.seeds)
    images, layouts, z_theta = read_versions(cfg, scenes, study.scenes)
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
    for t in demonstrations(cfg, scenes):
        labels = stream(study.root_seed, "permuted", t.user, t.seed).permutation(t.valid.ravel())
        permuted.append(replace(t, valid=labels.reshape(t.valid.shape)))
    compared = [name for name, variant in cfg.variants.items() if variant.compared]
    flat = np.concatenate(images), np.tile(z_theta, (len(images), 1, 1))
    p_permuted = refit_and_predict(cfg, dict.fromkeys(compared, permuted), *flat, "permuted labels")

    summary = []
    for variant, p in p_by_variant.items():
        p = p.reshape(len(users), len(seeds), *image_sets.shape[:3], -1)  # (user, seed, set, version, scene, path)
        item_effects, *others = (added_item_effects(p[:, :, i]) for i in range(len(image_sets)))
        near_nothing = refuters.mean_over_paths(p[:, :, 0, 1:], far) - refuters.mean_over_paths(p[:, :, 0, :1], far)
        control_effects = np.moveaxis(near_nothing[..., far_scenes], 2, 1).reshape(len(item_effects), len(seeds), -1)
        by_refuter: dict[tuple[str, str], Effects] = {}
        if variant in p_permuted:
            by_refuter[refuters.DUMMY_OUTCOME, "permuted labels"] = added_item_effects(
                p_permuted[variant].reshape(len(users), len(seeds), *images.shape[:2], -1)
            )
        by_refuter |= {(refuters.PLACEBO_TREATMENT, x): e for x, e in zip(patches, others, strict=False)}
        by_refuter[refuters.NEGATIVE_CONTROL, f"far_m={study.far_m}"] = control_effects
        for texture, effects in zip(elsewhere, others[len(patches) :], strict=True):
            by_refuter[refuters.OTHER_ENVIRONMENT, texture] = effects - item_effects
        judged = {}
        for key, effects in by_refuter.items():
            held = items[:, far_scenes] if key[0] == refuters.NEGATIVE_CONTROL else items
            judged[key] = estimate_effects(effects, held).assign(expected=NEGLIGIBLE)
        halves = refuters.data_subset(stream(study.root_seed, "halves", variant), item_effects, study.halves, items)
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


if __name__ == "__main__":
    launch(main, "refutation")
