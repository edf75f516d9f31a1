"""What a reader can try: models, scenes and repairs of the panel."""

from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.added import Added
from pipeline.artifacts.files import read_arrays
from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.artifacts.trained import load_model
from pipeline.exhibits.choice import repairs_of, with_something_invalid
from pipeline.report.figures.things import Seen
from pipeline.report.panel import Ascents, Scene, panel
from pipeline.report.results import Results
from pipeline.report.wording import listed
from pipeline.spec.specification import Specification
from pipeline.table.bezier import lattice
from pipeline.table.layout import SYMBOLS, Layouts


def panel_data(cfg: DictConfig, results: Results, scenes: SceneSet, added: Added, seen: Mapping[str, Seen]) -> dict:
    """What a reader can try: every model of the first seed, of users to whom some path is invalid."""
    seed = results.seeds[0]
    users = {user: cfg.users[user] for user in with_something_invalid(results)}
    models = {u: {v: load_model(cfg, v, u, seed, cfg.study_n) for v in results.variants} for u in users}
    frame = results.repairs[results.repairs["seed"] == seed]
    paths = read_arrays(Path(cfg.paths.repair) / "paths.npz")
    repaired = {u: {v: repairs_of(frame, paths, v, u, seed) for v in results.variants} for u in users}
    splits = {}
    for split, shared in results.splits.items():
        pool = shared or train_pool(seed)
        images, layouts = scenes.images[pool], scenes.layouts[pool]
        further = added if split == cfg.intervene.split else None
        here = repaired if split == cfg.repair.split else {}
        splits[split] = [
            _panel_scene(cfg, name, scene, *_tables(images[scene], layouts[[scene]], scene, further), models, here)
            for scene, name in _chosen_scenes(cfg, split, len(images), seen).items()
        ]
    return panel(splits, users, results.variants, cfg.report.panel_side)


def _chosen_scenes(cfg: DictConfig, split: str, count: int, seen: Mapping[str, Seen]) -> dict[int, str]:
    """Names of a split's first scenes and, among unseen items, of each user's worst, which is the last in `seen`."""
    worst = {user: s.scenes[-1] for user, s in seen.items()} if split == "new_items" else {}
    names = {}
    for scene in sorted({*range(min(cfg.report.panel_scenes, count)), *worst.values()}):
        users = [user for user in worst if worst[user] == scene]
        names[scene] = f"Scene {scene + 1}" + (f", worst for {listed(users)}" if users else "")
    return names


def _panel_scene(
    cfg: DictConfig, name: str, scene: int, images: np.ndarray, layouts: Layouts, models: dict, repaired: dict
) -> Scene:
    """What every model (by user and variant) believes of a scene's tables, and its repairs there, if there are any."""
    cells = lattice(cfg.report.panel_side)
    everywhere = np.broadcast_to(cells, (len(images), *cells.shape))
    maps = {u: {v: model.probability(images, everywhere) for v, model in own.items()} for u, own in models.items()}
    repairs = {
        u: {v: _ascents(models[u][v], rows, z, scene, images[:1]) for v, (rows, z) in own.items()}
        for u, own in repaired.items()
    }
    return Scene(name, list(SYMBOLS[: len(images) - 1]), images, layouts, maps, repairs)


def _tables(image: np.ndarray, layout: Layouts, scene: int, added: Added | None) -> tuple[np.ndarray, Layouts]:
    """Pictures and layouts of a scene as it is, then with each added item."""
    if added is None:
        return image[None], layout
    parts = [layout, *(with_item[[scene]] for with_item in added.layouts)]
    layouts = Layouts(*(np.concatenate([getattr(x, f.name) for x in parts]) for f in fields(Layouts)))
    return np.concatenate([image[None], added.images[:, scene]]), layouts


def _ascents(model: Specification, rows: pd.DataFrame, z: np.ndarray, scene: int, image: np.ndarray) -> Ascents:
    """One scene's repairs by a model, and what it makes of every step."""
    at = np.flatnonzero(rows["scene"] == scene)
    p = model.probability(image, z[at].reshape(1, -1, 2)).reshape(z[at].shape[:2])
    return Ascents(rows["start"].to_numpy()[at], z[at], p)
