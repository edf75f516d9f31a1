"""Builders that tests of several packages share: tables, scenes, demonstrations, queries and untrained models."""

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import torch
import yaml
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import DEMO_COLUMNS, DEMO_KEY, Queries, write_demos, write_queries
from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.models import model_dir, save_weights, weights_path
from pipeline.artifacts.scenes import SceneSet, layout_table, train_pool, write_scenes
from pipeline.models.base import untrained
from pipeline.models.clearance.clearance import ClearanceModel, pack
from pipeline.models.irl.reward_map import RewardMap
from pipeline.models.trained import build
from pipeline.models.vae.beta_vae import BetaVae
from pipeline.models.vae.losses import Weights
from pipeline.params import compose
from pipeline.perception.objects import FEATURES
from pipeline.world.bezier import P_F, P_INIT, random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import (
    SIDE,
    SYMBOLS,
    Items,
    LayoutRules,
    Layouts,
    add_item,
    point_segment_distance,
    random_layouts,
    segment_distance,
)
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import Margins, valid

_composed = cache(lambda *overrides: compose(list(overrides)))


def composed(*overrides: str) -> DictConfig:
    """What `compose` gives, composed once for all tests: a copy that a test may change."""
    return _composed(*overrides).copy()


RULES = LayoutRules.of(composed().scenes.layout)
ITEMS = Items(np.arange(4), np.array([0.0, 0.0, 0.075, 0.0]), np.array([0.065, 0.075, 0.013, 0.045]))
# Per symbol a training item (0-3) and another one (4-7); the plate and the glass of the latter are oval.
ROUND_AND_OVAL = Items(
    np.tile(np.arange(4), 2),
    np.array([0.0, 0.0, 0.08, 0.0, 0.0, 0.038, 0.07, 0.015]),
    np.array([0.065, 0.075, 0.013, 0.045, 0.06, 0.054, 0.013, 0.0375]),
)

WEIGHTS = {  # of Eq. 1
    "full": Weights(alpha=10.0, beta=0.005, gamma=1.0),
    "ae": Weights(alpha=10.0, beta=0.0, gamma=1.0),
    "classifier": Weights(alpha=0.0, beta=0.0, gamma=1.0),
}
MARGINS: dict[str, Margins] = {  # [m] of the paper's users
    "careful": dict.fromkeys(SYMBOLS, 0.045),
    "normal": dict.fromkeys(SYMBOLS) | {"glass": 0.042},
    "aggressive": dict.fromkeys(SYMBOLS),
}
RED, WHITE = (0.8, 0.2, 0.2), (0.9, 0.9, 0.9)


def as_controls(z_theta: np.ndarray) -> np.ndarray:
    """The three control points [m] of the paper's paths."""
    ends = [np.broadcast_to(end, z_theta.shape) for end in (P_INIT, P_F)]
    return np.stack([ends[0], z_theta, ends[1]], axis=-2)


def with_value(cfg: DictConfig, row: str) -> DictConfig:
    """The configuration after a value in YAML was set, e.g. "users.careful.glass=null"."""
    name, _, value = row.partition("=")
    OmegaConf.set_struct(cfg, False)
    OmegaConf.update(cfg, name, yaml.safe_load(value), merge=False)
    return cfg


def vae(seed: int = 0, **shape: object) -> BetaVae:
    """An untrained model, of the paper's size if `shape` names no other."""
    model = build({"kind": "vae", "model": shape}, seed)
    assert isinstance(model, BetaVae)
    return model


def clearance_model(seed: int = 0, **shape: object) -> ClearanceModel:
    """An untrained model, of four members if `shape` names no other number."""
    model = untrained(ClearanceModel, {"members": 4} | shape, seed)
    assert isinstance(model, ClearanceModel)
    return model


def reward_model(seed: int = 0, **shape: object) -> RewardMap:
    """An untrained reward map, small if `shape` says nothing else."""
    small = {"channels": 8, "dilated": 2, "gain": 10.0, "dropout": 0.1, "lattice_side": 10}
    model = build({"kind": "reward", "model": small | shape}, seed)
    assert isinstance(model, RewardMap)
    return model


def noise_demos(seed: int, scenes: int = 3, n: int = 4) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Dark noise for images, as gradients of grey cancel, and paths; one in four is valid, the first is not."""
    rng = np.random.default_rng(seed)
    valid = rng.random((scenes, n)) < 0.25
    valid.flat[:2] = False, True
    return rng.integers(0, 128, (scenes, 100, 100, 3), dtype=np.uint8), rng.uniform(-0.2, 1.2, (scenes, n, 2)), valid


def percept(layouts: Layouts) -> torch.Tensor:
    """Layouts as the clearance model perceives them, in double precision: the same features for all objects."""
    features, doubt = np.zeros((*layouts.present.shape, len(FEATURES))), np.zeros(len(layouts))
    kinds = np.zeros((*layouts.present.shape, 0))
    return pack(layouts.ends, layouts.radius, features, layouts.present, doubt, kinds)


def assert_clear(layouts: Layouts, rules: LayoutRules = RULES, items: float = 1e-9, ends: float = 1e-9) -> None:
    """Footprints are clear of one another and of the task's ends as the rules say, but for these roundings [m]."""
    for scene in range(len(layouts)):
        slots = np.flatnonzero(layouts.present[scene])
        axes, radius = layouts.ends[scene, slots], layouts.radius[scene, slots]
        apart = segment_distance(axes[:, None], axes) - radius[:, None] - radius
        away = [point_segment_distance(p, axes[:, 0], axes[:, 1]) - radius for p in (P_INIT, P_F)]
        assert apart[~np.eye(len(slots), dtype=bool)].min(initial=np.inf) >= rules.clear_of_items - items
        assert np.min(away, initial=np.inf) >= rules.clear_of_ends - ends


def draw_table(*discs, seed=0, grain=0.02) -> np.ndarray:
    """A table of its own grain, with discs (x, y, radius [m], colour) on it."""
    rng = np.random.default_rng(seed)
    image = 0.5 + grain * rng.standard_normal((SIDE, SIDE, 3))
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    for at_x, at_y, radius, colour in discs:
        image[np.hypot(x - SIDE * at_x, SIDE * (1 - at_y) - y) < SIDE * radius] = colour
    return (255 * image.clip(0, 1)).round().astype(np.uint8)


def capsules(rng: np.random.Generator, scenes: int = 20, slots: int = 3) -> Layouts:
    """Capsules anywhere, also across one another."""
    none = np.zeros((scenes, slots), int)
    return Layouts(
        none, none.copy(), rng.uniform(0.1, 0.9, (scenes, slots, 2)), rng.uniform(-3, 3, none.shape),
        np.ones(none.shape), rng.uniform(0, 0.1, none.shape), rng.uniform(0.01, 0.08, none.shape),
    )  # fmt: skip


def two_discs(rng: np.random.Generator, count: int, red: bool = True) -> tuple[Layouts, np.ndarray]:
    """Layouts and images of a large red and a small white disc each; without `red`, the images lack that one."""
    layouts = capsules(rng, count, 2)
    layouts.half_length[:], layouts.radius[:] = 0, (0.075, 0.045)
    layouts.centre[:, 0] = rng.uniform((0.12, 0.55), (0.45, 0.88), (count, 2))
    layouts.centre[:, 1] = rng.uniform((0.55, 0.12), (0.88, 0.45), (count, 2))
    discs = [[(*b, 0.045, WHITE), (*a, 0.075, RED)][: 1 + red] for a, b in layouts.centre]
    return layouts, np.stack([draw_table(*each, seed=i) for i, each in enumerate(discs)])


def rendered_scenes(cfg: DictConfig, pools: Mapping[str, tuple[int, str]]) -> SceneSet:
    """Write rendered scenes: for each pool their number and the split of their items."""
    catalogue, rng = read_catalogue(Path(cfg.paths.data)), np.random.default_rng(0)
    rules = LayoutRules.of(cfg.scenes.layout)
    layouts = {
        pool: random_layouts(rng, count, catalogue.footprints, catalogue.pool(split), rules)
        for pool, (count, split) in pools.items()
    }
    return write_rendered(cfg, layouts)


def write_rendered(cfg: DictConfig, layouts: dict[str, Layouts]) -> SceneSet:
    """Write the scenes of these layouts, rendered on one table top."""
    images = {pool: rendered(cfg, x) for pool, x in layouts.items()}
    scenes = SceneSet(images, layouts, {pool: appearances(len(x)) for pool, x in layouts.items()})
    write_scenes(Path(cfg.paths.scenes), scenes)
    return scenes


def appearances(scenes: int) -> pd.DataFrame:
    return pd.DataFrame({"texture": "oak", "render_seed": range(scenes)})


def rendered(cfg: DictConfig, layouts: Layouts) -> np.ndarray:
    palette = Palette(read_catalogue(Path(cfg.paths.data)))
    return render_scenes(layouts, ["oak"] * len(layouts), range(len(layouts)), palette)


def symbols_added(cfg: DictConfig, scenes: SceneSet, paths: int) -> None:
    """Stage intervene's scenes: those of `new_items` with each symbol added, and `paths` z_theta [m] in each."""
    catalogue, rng = read_catalogue(Path(cfg.paths.data)), np.random.default_rng(0)
    new, rules, more = scenes.layouts["new_items"], LayoutRules.of(cfg.scenes.layout), catalogue.pool("unseen")
    added = [add_item(rng, new, i, catalogue.footprints, more, rules) for i in range(len(SYMBOLS))]
    tables = [layout_table(f"{symbol}-0", x) for symbol, x in zip(SYMBOLS, added, strict=True)]
    images = np.stack([rendered(cfg, x)[None] for x in added])
    write_table(Path(cfg.paths.intervene) / "layouts.parquet", pd.concat(tables))
    arrays = {"images": images, "z_theta": random_z_theta(rng, len(new), paths)}
    write_arrays(Path(cfg.paths.intervene) / "images.npz", arrays)


def labelled_demos(cfg: DictConfig, scenes: SceneSet) -> None:
    """Write every user's demonstrations in every seed's training scenes: random paths, labelled by the truth."""
    rng, parts = np.random.default_rng(0), []
    for seed, user in product(cfg.seeds, cfg.users):
        layouts = scenes.layouts[train_pool(seed)]
        z = random_z_theta(rng, len(layouts), cfg.demos.per_scene)
        keys = pd.MultiIndex.from_product([[seed], [user], *map(range, z.shape[:2])], names=DEMO_KEY)
        labels = valid(layouts, z, cfg.users[user]).ravel()
        parts.append(keys.to_frame(index=False).assign(z_x=z[..., 0].ravel(), z_y=z[..., 1].ravel(), valid=labels))
    write_table_of_demos(Path(cfg.paths.demos), pd.concat(parts, ignore_index=True))


def labelled_queries(cfg: DictConfig, scenes: SceneSet, pools: Sequence[str], count: int) -> None:
    """Write `count` random paths in every scene of these pools, with every user's true labels."""
    rng, queries = np.random.default_rng(1), {}
    for pool in pools:
        z = random_z_theta(rng, len(scenes.layouts[pool]), count)
        truth = {user: valid(scenes.layouts[pool], z, margins) for user, margins in cfg.users.items()}
        queries[pool] = Queries(z, truth)
    write_queries(Path(cfg.paths.demos), queries)


def models_in_rendered_scenes(folder: Path, variants: Sequence[str], count: int, *overrides: str) -> DictConfig:
    """The configuration of `count` real scenes of unseen items, and models of these variants, under `folder`."""
    cfg = composed("profile=smoke", "workers=1", *overrides)
    for stage in ("scenes", "train", "irl", "clearance", "intervene"):
        OmegaConf.update(cfg, f"paths.{stage}", str(folder / stage))
    cfg.variants = {variant: cfg.variants[variant] for variant in variants}
    rendered_scenes(cfg, {"new_items": (count, "unseen")})
    for variant in variants:
        for user in cfg.users:
            for seed in cfg.protocol.seeds:
                model = build(cfg.variants[variant], seed)
                if isinstance(model, ClearanceModel):
                    model.evidence.fill_(20.0)  # for what it was drawn to believe
                file = weights_path(model_dir(cfg, variant), user, seed, cfg.main_n_demos)
                save_weights(file, model.state_dict())
    return cfg


def random_demos(rng: np.random.Generator, cfg: DictConfig, scenes: int) -> pd.DataFrame:
    """Ten demonstrations of every seed and user in each scene, with random paths and labels."""
    keys = pd.MultiIndex.from_product([list(cfg.seeds), sorted(cfg.users), range(scenes), range(10)], names=DEMO_KEY)
    demos = keys.to_frame(index=False)
    z = random_z_theta(rng, len(demos))
    return demos.assign(z_x=z[:, 0], z_y=z[:, 1], valid=rng.random(len(demos)) < 0.5)


def write_table_of_demos(folder: Path, table: pd.DataFrame) -> None:
    """Write demonstrations without trajectories; columns that `table` lacks are 0."""
    demos = table.reindex(columns=DEMO_COLUMNS, fill_value=0)
    write_demos(folder, demos, np.zeros((0, 4)), np.zeros(len(demos) + 1))
