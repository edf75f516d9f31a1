"""Stage refutation: ask models questions with a known true answer, and judge the answers as stage intervene does."""

from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.files import read_arrays, write_arrays, write_table
from pipeline.artifacts.scenes import AddedItems, SceneSet, read_interventions, read_scenes, train_pool
from pipeline.causal import refuters
from pipeline.causal.added_items import added_item_effects, questions
from pipeline.causal.interventions import estimate_effects
from pipeline.launch import launch
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.training.refit import TrainingSet, refit_and_predict
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import clearance
from pipeline.world.source import ImageSource

Images = UInt8[Array, "version scene 100 100 3"]  # version 0 is the original scene, 1 + k has symbol k added
Effects = Float[Array, "question seed scene"]
NEGLIGIBLE = "negligible"  # expected verdict of every refuter except data_subset
COLUMNS = ["refuter", "setting", "variant", "user", "symbol", "effect", "ci_low", "ci_high", "p_holm", "verdict",
           "expected", "passed", "agreement", "item_effect", "note"]  # fmt: skip


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write effects.parquet, summary.csv, and examples.npz: each placebo patch in the first scene, by symbol."""
    check_weights(cfg)
    study, users, seeds = cfg.studies.refutation, list(cfg.evaluate.users), list(cfg.protocol.seeds)
    pool, first = cfg.protocol.splits[cfg.intervene.split], slice(study.scenes)
    scenes = read_scenes(Path(cfg.paths.scenes))
    scenes.check_has(pool, *map(train_pool, seeds))
    added = read_interventions(Path(cfg.paths.intervene), scenes.layouts[pool])
    z_theta = read_arrays(Path(cfg.paths.intervene) / "images.npz")["z_theta"][first]
    images = np.concatenate([scenes.images[pool][None, first], added.images[:, first]])  # (version, scene, ...)
    far = np.stack([clearance(item[first], z_theta)[..., 0] > study.far_m for item in added.placed])
    far_scenes = far.any(-1).all(0)  # (scene,)
    if far_scenes.sum() < 2:
        raise InputError(
            f"studies.refutation.far_m is {study.far_m}: expected a length that paths of at least two scenes keep from "
            "each added item; lower it"
        )

    # Each set of images is predicted once; a refuter compares versions of one or two sets.
    patches = {piece: placebo_images(cfg, images, piece) for piece in study.pieces}
    elsewhere = render_elsewhere(cfg, scenes, pool, added)
    image_sets = np.stack([images, *patches.values(), *elsewhere.values()])  # (set, version, scene, ...)
    flat_images = image_sets.reshape(-1, *images.shape[2:])
    repeated = np.tile(z_theta, (len(flat_images) // len(z_theta), 1, 1))
    p_by_variant = predict_all(cfg, users, flat_images, repeated, "refutation")
    dummy_effects = refit_on_permuted_labels(cfg, scenes, users, images, z_theta)

    summary, rows = [], []
    for variant, p in p_by_variant.items():
        p = p.reshape(len(users), len(seeds), *image_sets.shape[:3], -1)  # (user, seed, set, version, scene, path)
        item_effects, *others = (added_item_effects(p[:, :, i]) for i in range(len(image_sets)))
        near_nothing = refuters.mean_over_paths(p[:, :, 0, 1:], far) - refuters.mean_over_paths(p[:, :, 0, :1], far)
        control_effects = np.moveaxis(near_nothing[..., far_scenes], 2, 1).reshape(len(item_effects), len(seeds), -1)
        placebo_effects, other_effects = others[: len(patches)], others[len(patches) :]
        by_refuter: dict[tuple[str, str], Effects] = {}
        if variant in dummy_effects:
            by_refuter[refuters.DUMMY_OUTCOME, "permuted labels"] = dummy_effects[variant]
        for piece, effects in zip(patches, placebo_effects, strict=True):
            by_refuter[refuters.PLACEBO_TREATMENT, f"piece={piece}"] = effects
        by_refuter[refuters.NEGATIVE_CONTROL, f"far_m={study.far_m}"] = control_effects
        for texture, effects in zip(elsewhere, other_effects, strict=True):
            by_refuter[refuters.OTHER_ENVIRONMENT, f"texture={texture}"] = effects - item_effects
        for (refuter, setting), effects in by_refuter.items():
            judged = estimate_effects(effects).assign(expected=NEGLIGIBLE)
            summary.append(summary_rows(users, refuter, setting, variant, judged, item_effects))
            rows.append(effect_rows(users, seeds, refuter, setting, variant, effects))
        halves = refuters.data_subset(stream(study.root_seed, "halves", variant), item_effects, study.halves)
        summary.append(
            summary_rows(users, refuters.DATA_SUBSET, f"halves={study.halves}", variant, halves, item_effects)
        )
        rows.append(effect_rows(users, seeds, "none", "", variant, item_effects))
    write_table(out_dir / "effects.parquet", pd.concat(rows, ignore_index=True))
    write_table(out_dir / "summary.csv", pd.concat(summary, ignore_index=True)[COLUMNS])
    write_arrays(out_dir / "examples.npz", {f"piece={piece}": x[1:, 0] for piece, x in patches.items()})


def placebo_images(cfg: DictConfig, images: Images, piece: int) -> Images:
    """Return the images with each added item replaced by a patch of its shuffled pixels."""
    rng = stream(cfg.studies.refutation.root_seed, "placebo", piece)
    patched = [refuters.placebo_patch(rng, images[0], with_item, piece) for with_item in images[1:]]
    return np.stack([images[0], *patched])


def render_elsewhere(cfg: DictConfig, scenes: SceneSet, pool: str, added: AddedItems) -> dict[str, Images]:
    """Return texture -> the scenes without and with each added item on that table top, under another light."""
    study, catalogue = cfg.studies.refutation, read_catalogue(Path(cfg.paths.data))
    textures, first = catalogue.texture_names(study.textures), slice(study.scenes)
    if not textures:
        splits = ", ".join(sorted(set(catalogue.textures["split"])))
        raise InputError(f"studies.refutation.textures is {study.textures!r}: expected one of {splits}")
    layouts = [x[first] for x in (scenes.layouts[pool], *added.layouts)]
    palette = Palette(catalogue, ImageSource.of(cfg.scenes.source))
    seeds = stream(study.root_seed, "lights").integers(2**31, size=len(layouts[0])).tolist()
    return {
        texture: np.stack([render_scenes(x, [texture] * len(x), seeds, palette) for x in layouts])
        for texture in textures
    }


def refit_on_permuted_labels(
    cfg: DictConfig, scenes: SceneSet, users: list[str], images: Images, z_theta: Float[Array, "scene path 2"]
) -> dict[str, Effects]:
    """Fit variants to demonstrations with permuted labels; return variant -> effects of the added items."""
    study, seeds, demos = cfg.studies.refutation, list(cfg.protocol.seeds), read_demos(Path(cfg.paths.demos))
    training_sets = []
    for user in users:
        for seed in seeds:
            paths, labels = demo_arrays(demos, seed, user, cfg.main_n_demos)
            permuted = stream(study.root_seed, "permuted", user, seed).permutation(labels.ravel()).reshape(labels.shape)
            training_sets.append(TrainingSet(user, seed, scenes.images[train_pool(seed)], paths, permuted))
    flat_images, repeated = images.reshape(-1, *images.shape[2:]), np.tile(z_theta, (len(images), 1, 1))
    each = dict.fromkeys(study.dummy_outcome, training_sets)
    p = refit_and_predict(cfg, each, flat_images, repeated, "permuted labels")
    shape = len(users), len(seeds), *images.shape[:2], -1
    return {variant: added_item_effects(x.reshape(shape)) for variant, x in p.items()}


def summary_rows(
    users: list[str], refuter: str, setting: str, variant: str, judged: pd.DataFrame, item_effects: Effects
) -> pd.DataFrame:
    """Return COLUMNS of every question.

    passed: the verdict is the expected one, so "undecided" does not pass; item_effect: the effect of the unaltered item
    in the same scenes.
    """
    tuned = (refuter, setting) == (refuters.PLACEBO_TREATMENT, f"piece={refuters.TUNED_PIECE_PX}")
    table = pd.concat([questions(users), judged], axis=1).assign(
        refuter=refuter,
        setting=setting,
        variant=variant,
        passed=judged["verdict"] == judged["expected"],
        item_effect=item_effects.mean((1, 2)),
        note=refuters.TUNED_NOTE if tuned else "",
    )
    return table.reindex(columns=COLUMNS)


def effect_rows(
    users: list[str], seeds: list[int], refuter: str, setting: str, variant: str, effects: Effects
) -> pd.DataFrame:
    """Return one row per question, seed and scene (numbered among the scenes of the question)."""
    index = pd.MultiIndex.from_product(
        [users, SYMBOLS, seeds, range(effects.shape[-1])], names=["user", "symbol", "seed", "scene"]
    )
    key = {"refuter": refuter, "setting": setting, "variant": variant}
    return pd.DataFrame(key, index=index).assign(effect=effects.ravel()).reset_index()[[*key, *index.names, "effect"]]


if __name__ == "__main__":
    launch(main, "refutation")
