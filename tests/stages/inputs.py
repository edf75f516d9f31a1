"""What stages that ask trained models read: a few scenes, and untrained models in the place of trained ones."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.models import model_dir, save_model
from pipeline.artifacts.scenes import SceneSet, train_pool, write_scenes
from pipeline.params import compose
from pipeline.spec.registry import build
from pipeline.table.items import read_catalogue
from pipeline.table.layout import Items, LayoutRules, random_layouts
from pipeline.table.render import Palette, render_scenes

ITEMS = Items(np.arange(4), np.array([0.0, 0.0, 0.075, 0.0]), np.array([0.065, 0.075, 0.013, 0.045]))
RULES = LayoutRules((2, 3), (0.05, 0.35, 0.40, 0.20), 0.12, 0.88, 0.12, 0.015, 0.97, 1.03)
SCENES = 3
SMALL_WORLD = [  # stages scenes and demos, in seconds
    "profile=smoke", "workers=1", "scenes.shared=3", "scenes.validation=1", "scenes.calibration=5",
    "scenes.calibration_paths=4", "scenes.prior_side=4", "demos.queries_seen=2",
]  # fmt: skip


def untrained_models(folder: Path, seeds: list[int], *overrides: str) -> DictConfig:
    """The configuration of three variants whose scenes and models, of every user and seed, lie under `folder`."""
    few = ["workers=1", "repair.starts=8", "repair.lattice_side=14"]  # starts: some invalid to each user, however drawn
    cfg = compose(["profile=smoke", f"seeds={seeds}", *few, *overrides])
    OmegaConf.set_struct(cfg, False)
    for name in ("ae", "classifier", "irl_maxent"):
        del cfg.variants[name]
    for stage in ("scenes", "train", "irl", "path"):
        OmegaConf.update(cfg, f"paths.{stage}", str(folder / stage))
    rng = np.random.default_rng(0)
    pools = [*map(train_pool, seeds), "new_items"]
    look = pd.DataFrame({"texture": ["oak"] * SCENES, "render_seed": range(SCENES)})
    scenes = SceneSet(
        {pool: rng.integers(0, 256, (SCENES, 100, 100, 3), dtype=np.uint8) for pool in pools},
        {pool: random_layouts(rng, SCENES, ITEMS, np.arange(4), RULES) for pool in pools},
        dict.fromkeys(pools, look),
    )
    write_scenes(folder / "scenes", scenes)
    for variant in cfg.variants:
        for user in cfg.users:
            for seed in seeds:
                save_model(model_dir(cfg, variant), build(cfg.variants[variant]), user, seed, cfg.study_n)
    return cfg


def pictured_models(folder: Path, variants: Sequence[str], count: int, *overrides: str) -> DictConfig:
    """The configuration of `count` real scenes of unseen items, and models of these variants, under `folder`."""
    cfg = compose(["profile=smoke", "workers=1", *overrides])
    for stage in ("scenes", "train", "irl", "path", "intervene"):
        OmegaConf.update(cfg, f"paths.{stage}", str(folder / stage))
    cfg.variants = {variant: cfg.variants[variant] for variant in variants}
    catalogue, rng = read_catalogue(Path(cfg.paths.data)), np.random.default_rng(0)
    rules = LayoutRules((2, 3), (0.2, 0.4, 0.4), 0.12, 0.88, 0.12, 0.015, 0.97, 1.03)
    layouts = random_layouts(rng, count, catalogue.footprints, catalogue.pool("unseen"), rules)
    names = [catalogue.texture_names("train")[0]] * count
    images = render_scenes(layouts, names, range(count), Palette(catalogue))
    looks = pd.DataFrame({"texture": names, "render_seed": range(count)})
    scenes = SceneSet({"new_items": images}, {"new_items": layouts}, {"new_items": looks})
    write_scenes(Path(cfg.paths.scenes), scenes)
    for variant in variants:
        for user in cfg.users:
            for seed in cfg.protocol.seeds:
                save_model(model_dir(cfg, variant), build(cfg.variants[variant], seed), user, seed, cfg.study_n)
    return cfg
