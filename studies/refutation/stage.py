"""Stage refute: asks the models questions whose true answer is "nothing", and sees what the procedure makes of it."""

from collections import Counter
from dataclasses import asdict
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.effects import read_effects
from pipeline.artifacts.files import read_arrays, write_arrays, write_json
from pipeline.artifacts.interventions import AddedItems, read_interventions
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.artifacts.trained import check_weights, predict_all
from pipeline.causal.interventions import DIGITS, by_user, expected_validity, judge
from pipeline.causal.refuters import PATCHES, REFUTERS, halves, mean_over, placebo, stays_over_items
from pipeline.launch import launch
from pipeline.models.registry import build
from pipeline.params import need
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.streams import job_seed, stream
from pipeline.stats.crossed import VERDICTS
from pipeline.training.refit import TrainingSet, refit_and_predict
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import clearance

Effects = Float[Array, "user symbol seed scene"]


def main(cfg: DictConfig, out_dir: Path) -> None:
    """metrics.json, and placebos.npz (symbol, scene, 100, 100, 3): an item's pixels, or pieces of it, shuffled."""
    check_weights(cfg)
    directory, pool, few = Path(cfg.paths.intervene), cfg.protocol.splits[cfg.intervene.split], slice(cfg.refute.scenes)
    scenes = read_scenes(Path(cfg.paths.scenes))
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    added = read_interventions(directory, scenes.layouts[pool])
    _check_items(added)
    z = read_arrays(directory / "images.npz")["z_theta"][few]
    here = np.concatenate([scenes.images[pool][None, few], added.images[:, few]])  # (1 + symbol, scene, ...)
    patches = {kind: _patches(cfg, here, kind, piece) for kind, piece in PATCHES.items()}
    far = np.stack([clearance(placed[few], z)[..., 0] > cfg.refute.far_m for placed in added.placed])

    few_stay = "a length that paths of at least two scenes keep from each added item: lower it"
    need(cfg, "refute.far_m", bool(far.any(-1).all(0).sum() > 1), few_stay)

    users = list(cfg.evaluate.users)
    measured = read_effects(directory, list(cfg.variants), users)
    elsewhere = _elsewhere(cfg, scenes, pool, added)
    pictures = np.concatenate([here, *patches.values(), *elsewhere.values()])
    images, everywhere = pictures.reshape(-1, *pictures.shape[2:]), np.tile(z, (len(pictures), 1, 1))
    permuted, untrained = _permuted(cfg, users, here, z), _untrained(cfg, users, here, z)
    found, own = {}, {}
    for variant, p in predict_all(cfg, users, images, everywhere, "refute").items():
        p = p.reshape(*p.shape[:2], *pictures.shape[:2], -1)  # (user, seed, table, scene, path)
        now, *patched, others = np.split(p, np.cumsum([len(here), *map(len, patches.values())]), axis=2)
        own[variant] = _effects(now)
        near_nothing = mean_over(now[:, :, 1:], far) - mean_over(now[:, :, :1], far)
        found[variant] = {
            **({"permuted": _effects(permuted[variant])} if variant in permuted else {}),
            "untrained": _effects(untrained[variant]),
            **{
                kind: _effects(np.concatenate([now[:, :, :1], of], axis=2))
                for kind, of in zip(patches, patched, strict=True)
            },
            "far": np.moveaxis(near_nothing[..., np.isfinite(near_nothing).all((0, 1, 2))], 2, 1),
            **{
                f"other_table/{top}": _effects(other) - own[variant]
                for top, other in zip(elsewhere, np.split(others, len(elsewhere), axis=2), strict=True)
            },
        }
    write_arrays(out_dir / "placebos.npz", patches)
    write_json(out_dir / "metrics.json", _metrics(cfg, users, found, own, measured, added.item))


def _patches(cfg: DictConfig, tables: np.ndarray, name: str, piece: int) -> np.ndarray:
    """Each symbol's patches (symbol, scene, 100, 100, 3); tables (1 + symbol, ...): the first without an item."""
    rng = stream(cfg.refute.root_seed, name)
    return np.stack([placebo(rng, tables[0], with_item, piece) for with_item in tables[1:]])


def _check_items(added: AddedItems) -> None:
    """Raise InputError unless two items at least of each symbol were added."""
    for symbol, of_symbol in zip(SYMBOLS, added.item, strict=True):
        if len(np.unique(of_symbol)) < 2:
            raise InputError(
                f"the same {symbol} was added to all {len(of_symbol)} scenes: expected at least two different ones; "
                "intervene on more scenes"
            )


def _elsewhere(cfg: DictConfig, scenes: SceneSet, pool: str, added: AddedItems) -> dict[str, np.ndarray]:
    """The scenes as they are, then with each added item, by another table top: (1 + symbol, scene, 100, 100, 3)."""
    catalogue = read_catalogue(Path(cfg.paths.data))
    names, few = catalogue.texture_names(cfg.refute.tables), slice(cfg.refute.scenes)
    need(cfg, "refute.tables", bool(names), f"one of {', '.join(sorted(set(catalogue.textures['split'])))}")
    palette, tables = Palette(catalogue), [scenes.layouts[pool][few], *(x[few] for x in added.layouts)]
    lights = stream(cfg.refute.root_seed, "lights").integers(2**31, size=len(tables[0])).tolist()
    return {
        top: np.stack([render_scenes(layouts, [top] * len(layouts), lights, palette) for layouts in tables])
        for top in names
    }


def _permuted(cfg: DictConfig, users: list[str], tables: np.ndarray, z: np.ndarray) -> dict[str, np.ndarray]:
    """P(valid) by models trained on permuted labels, variant -> (user, seed, table, scene, path)."""
    demos, scenes = read_demos(Path(cfg.paths.demos)), read_scenes(Path(cfg.paths.scenes))

    def training_set(user: str, seed: int) -> TrainingSet:
        paths, labels = demo_arrays(demos, seed, user, cfg.main_n_demos)
        rng = stream(cfg.refute.root_seed, "permuted", user, seed)
        permuted = rng.permutation(labels.ravel()).reshape(labels.shape)
        return TrainingSet(user, seed, scenes.images[train_pool(seed)], paths, permuted)

    training_sets = [training_set(user, seed) for user in users for seed in cfg.protocol.seeds]
    images, everywhere = tables.reshape(-1, *tables.shape[2:]), np.tile(z, (len(tables), 1, 1))
    found = refit_and_predict(
        cfg, dict.fromkeys(cfg.refute.permuted, training_sets), images, everywhere, "permuted labels"
    )
    shape = (len(users), len(cfg.protocol.seeds), *tables.shape[:2], -1)
    return {variant: p.reshape(shape) for variant, p in found.items()}


def _untrained(cfg: DictConfig, users: list[str], tables: np.ndarray, z: np.ndarray) -> dict[str, np.ndarray]:
    """P(valid) by models as they are initialised, variant -> (user, seed, table, scene, path)."""
    images, everywhere = tables.reshape(-1, *tables.shape[2:]), np.tile(z, (len(tables), 1, 1))
    begun = [(variant, user) for variant in cfg.variants for user in users]
    answers = map_jobs(partial(_as_begun, cfg, images, everywhere), begun, cfg.workers, "untrained models")
    shape = (len(cfg.variants), len(users), len(cfg.protocol.seeds), *tables.shape[:2], -1)
    return dict(zip(cfg.variants, np.stack(answers).reshape(shape), strict=True))


def _as_begun(
    cfg: DictConfig, images: np.ndarray, z_theta: np.ndarray, of: tuple[str, str]
) -> Float[Array, "seed picture path"]:
    """P(valid) by a variant's models of a user before any training."""
    variant, user = of
    names = [job_seed(seed, user, "untrained", variant) for seed in cfg.protocol.seeds]
    return np.stack([build(cfg.variants[variant], name).probability(images, z_theta) for name in names])


def _effects(p: Float[Array, "user seed table scene path"]) -> Effects:
    """What each added item (tables 1, 2, ...) changes of the mean validity in table 0."""
    expected = expected_validity(p)
    return np.moveaxis(expected[:, :, 1:] - expected[:, :, :1], 2, 1)


def _metrics(
    cfg: DictConfig,
    users: list[str],
    found: dict[str, dict[str, Effects]],
    own: dict[str, Effects],
    measured: dict[str, np.ndarray],
    item: np.ndarray,
) -> dict:
    """Cells by refuter, variant, user and symbol, a family per refuter and variant; tallies; halves; over items.

    own: the items' own effects in the scenes that the refuters see; measured: in all that stage intervene saw;
    item: (symbol, scene), which one was added.
    """
    refuted, tallies = {}, {}
    for variant, by_refuter in found.items():
        for name, effects in by_refuter.items():
            cells = judge(effects.reshape(-1, *effects.shape[2:]))
            refuted.setdefault(name, {})[variant] = by_user(users, cells)
            count = Counter(c["verdict"] for c in cells)
            scenes = {"cells": len(cells), "scenes": effects.shape[-1]}
            tallies.setdefault(name, {})[variant] = {v: count[v] for v in VERDICTS} | scenes
    pooled = {kind: {v: judge(of[kind].mean(1)) for v, of in found.items()} for kind in PATCHES}
    return {
        "order": [name for kind in REFUTERS for name in refuted if name.partition("/")[0] == kind],
        "said": {name: asdict(refuter) for name, refuter in REFUTERS.items()},
        "refuters": refuted,
        "tallies": tallies,
        **{kind: {v: dict(zip(users, cells, strict=True)) for v, cells in of.items()} for kind, of in pooled.items()},
        "items_alone": {
            v: {u: round(float(e), DIGITS) for u, e in zip(users, effects.mean((1, 2, 3)), strict=True)}
            for v, effects in own.items()
        },
        "halves": {v: _halves(cfg, v, e) for v, e in measured.items()},
        "items": {v: _over_items(e, item) for v, e in measured.items()},
        "seeds": len(cfg.protocol.seeds),
    }


def _halves(cfg: DictConfig, variant: str, effects: Float[Array, "cell seed scene"]) -> dict[str, float]:
    """The whole's verdicts that its halves share: on average, and in the cell where fewest do."""
    rng = stream(cfg.refute.root_seed, "halves", variant)
    shared, spread = halves(rng, effects, cfg.refute.halves)
    numbers = {"same": shared.mean(), "least": shared.min(), "spread": spread.mean()}
    return {name: round(float(value), DIGITS) for name, value in numbers.items()} | {"scenes": effects.shape[-1]}


def _over_items(effects: Float[Array, "cell seed scene"], item: np.ndarray) -> dict[str, int]:
    """How many of the verdicts stay if items take the place of scenes; and items of the symbol that has fewest."""
    by_cell = np.tile(item[np.argsort(SYMBOLS)], (len(effects) // len(SYMBOLS), 1))  # cells as read_effects has them
    stays = stays_over_items(effects, by_cell)
    return {"same": int(stays.sum()), "cells": len(stays), "items": min(len(np.unique(i)) for i in item)}


if __name__ == "__main__":
    launch(main, "refute")
