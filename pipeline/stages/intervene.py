"""Stage intervene: asks every model what an added item, or another user, changes, beside the true answer."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.artifacts.scenes import layout_table, read_scenes
from pipeline.artifacts.trained import check_weights, predict_all
from pipeline.causal.interventions import by_user, expected_validity, ordered_pairs, over_placements, study, tally
from pipeline.causal.scm import PARENTS
from pipeline.launch import launch
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import SYMBOLS, LayoutRules, Layouts, add_item
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import valid


@dataclass(frozen=True)
class Tables:
    """What is asked about: the scenes as they are, then every (symbol, placement) of an added item.

    images (1 + symbol * placement, scene, 100, 100, 3); z_theta [m] (scene, path, 2), the same for all.
    """

    layouts: list[Layouts]
    images: np.ndarray
    z_theta: np.ndarray


@dataclass(frozen=True)
class Answers:
    """E[V] by scene: baseline (..., scene), intervened (..., symbol, placement, scene)."""

    baseline: np.ndarray
    intervened: np.ndarray


def main(cfg: DictConfig, out_dir: Path) -> None:
    """effects.parquet, specifications.parquet, images.npz, layouts.parquet, table.csv and metrics.json."""
    users, seeds = list(cfg.users), list(cfg.protocol.seeds)
    check_weights(cfg)
    tables = _set_tables(cfg)
    truth = _fold(cfg, np.stack([_true_answers(tables, cfg.users[user]) for user in users]))
    answers = _model_answers(cfg, tables)
    effects = [_effect_rows(v, users, seeds, a, truth) for v, a in answers.items()]
    specifications = [_specification_rows(v, users, seeds, a, truth) for v, a in answers.items()]
    metrics = _metrics(cfg, users, answers, truth)
    cells = [
        {"variant": v, "user": u, "symbol": s, **cell}
        for v, by_user in metrics["interventions"].items()
        for u, by_symbol in by_user.items()
        for s, cell in by_symbol.items()
    ]
    write_table(out_dir / "effects.parquet", pd.concat(effects, ignore_index=True))
    write_table(out_dir / "specifications.parquet", pd.concat(specifications, ignore_index=True))
    added = tables.images[1:].reshape(len(SYMBOLS), cfg.intervene.placements, *tables.images.shape[1:])
    write_arrays(out_dir / "images.npz", {"images": added, "z_theta": tables.z_theta})
    names = [f"{symbol}-{k}" for symbol in SYMBOLS for k in range(cfg.intervene.placements)]
    rows = [layout_table(name, x) for name, x in zip(names, tables.layouts[1:], strict=True)]
    write_table(out_dir / "layouts.parquet", pd.concat(rows, ignore_index=True))
    write_table(out_dir / "table.csv", pd.DataFrame(cells))
    write_json(out_dir / "metrics.json", metrics)


def _set_tables(cfg: DictConfig) -> Tables:
    """Draw the paths, place each symbol in every scene, and picture it all under the scenes' own light."""
    scenes, pool = read_scenes(Path(cfg.paths.scenes)), cfg.protocol.splits[cfg.intervene.split]
    scenes.check_has(pool)
    catalogue = read_catalogue(Path(cfg.paths.data))
    layouts, looks = scenes.layouts[pool], scenes.appearances[pool]
    rules = LayoutRules.of(cfg.scenes.layout)
    choices = catalogue.pool(_items_split(catalogue, layouts, pool))
    rng, palette = stream(cfg.intervene.root_seed, "intervene", "placements"), Palette(catalogue)
    added = [
        add_item(rng, layouts, symbol, catalogue.footprints, choices, rules)
        for symbol in range(len(SYMBOLS))
        for _ in range(cfg.intervene.placements)
    ]
    pictures = [render_scenes(x, list(looks["texture"]), list(looks["render_seed"]), palette) for x in added]
    z_theta = random_z_theta(stream(cfg.intervene.root_seed, "intervene", "paths"), len(layouts), cfg.intervene.paths)
    return Tables([layouts, *added], np.stack([scenes.images[pool], *pictures]), z_theta)


def _items_split(catalogue: Catalogue, layouts: Layouts, pool: str) -> str:
    """The split of the items the scenes were drawn with: an added item comes from the same."""
    splits = set(catalogue.items["split"].iloc[np.unique(layouts.item[layouts.present])])
    if len(splits) != 1:
        raise InputError(f"scenes of {pool} hold items of {sorted(splits)}: expected one split of items.csv")
    return splits.pop()


def _model_answers(cfg: DictConfig, tables: Tables) -> dict[str, Answers]:
    """E[V] by variant: baseline (user, seed, scene), intervened (user, seed, symbol, placement, scene)."""
    images = tables.images.reshape(-1, *tables.images.shape[2:])  # (table * scene, 100, 100, 3)
    z = np.tile(tables.z_theta, (len(tables.images), 1, 1))  # (table * scene, path, 2)
    asked = predict_all(cfg, list(cfg.users), images, z, "intervene")
    return {v: _fold(cfg, _by_table(expected_validity(p), len(tables.images))) for v, p in asked.items()}


def _by_table(values: np.ndarray, tables: int) -> np.ndarray:
    """(..., table * scene) into (..., table, scene)."""
    return values.reshape(*values.shape[:-1], tables, -1)


def _true_answers(tables: Tables, margins: DictConfig) -> np.ndarray:
    """The world's own E[V], (table, scene), over the same paths."""
    return np.stack([expected_validity(valid(x, tables.z_theta, margins).astype(float)) for x in tables.layouts])


def _fold(cfg: DictConfig, expected: np.ndarray) -> Answers:
    """(..., 1 + symbol * placement, scene) into the scenes as they are and the added items."""
    before, after = expected[..., 0, :], expected[..., 1:, :]
    return Answers(before, after.reshape(*before.shape[:-1], len(SYMBOLS), cfg.intervene.placements, before.shape[-1]))


def _effect_rows(variant: str, users: list[str], seeds: list[int], model: Answers, truth: Answers) -> pd.DataFrame:
    """One row per (seed, user, scene, symbol, placement)."""
    user, seed, symbol, placement, scene = (i.ravel() for i in np.indices(model.intervened.shape))
    rows = pd.DataFrame(
        {
            "variant": variant,
            "seed": np.array(seeds)[seed],
            "user": np.array(users)[user],
            "scene": scene,
            "symbol": np.array(SYMBOLS)[symbol],
            "placement": placement,
            "baseline": model.baseline[user, seed, scene],
            "intervened": model.intervened.ravel(),
            "true_baseline": truth.baseline[user, scene],
            "true_intervened": truth.intervened[user, symbol, placement, scene],
        }
    )
    return _with_effects(rows).sort_values(["seed", "user", "scene", "symbol", "placement"], ignore_index=True)


def _specification_rows(
    variant: str, users: list[str], seeds: list[int], model: Answers, truth: Answers
) -> pd.DataFrame:
    """One row per (seed, scene, user, other): E[V | S = user] and under do(S := other)."""
    seed, scene = (i.ravel() for i in np.indices(model.baseline.shape[1:]))
    parts = [
        pd.DataFrame(
            {
                "variant": variant,
                "seed": np.array(seeds)[seed],
                "scene": scene,
                "user": user,
                "other": other,
                "baseline": model.baseline[users.index(user), seed, scene],
                "intervened": model.baseline[users.index(other), seed, scene],
                "true_baseline": truth.baseline[users.index(user), scene],
                "true_intervened": truth.baseline[users.index(other), scene],
            }
        )
        for user, other in ordered_pairs(users)
    ]
    return _with_effects(pd.concat(parts, ignore_index=True))


def _with_effects(rows: pd.DataFrame) -> pd.DataFrame:
    return rows.assign(
        effect=rows["intervened"] - rows["baseline"],
        true_effect=rows["true_intervened"] - rows["true_baseline"],
    )


def _metrics(cfg: DictConfig, users: list[str], answers: dict[str, Answers], truth: Answers) -> dict:
    """Every cell's statistics, a family per variant and inequality; the verdicts' tally; the graph."""
    pairs = ordered_pairs(users)
    influence = {v: _symbol_study(a, truth) for v, a in answers.items()}
    differences = {v: _user_study(users, a, truth) for v, a in answers.items()}
    return {
        "interventions": {v: by_user(users, cells) for v, cells in influence.items()},
        "specifications": {
            v: {u: {other: c for (s, other), c in zip(pairs, cells, strict=True) if s == u} for u in users}
            for v, cells in differences.items()
        },
        "verdicts": {v: tally(cells) for v, cells in influence.items()},
        "scm": {node: list(parents) for node, parents in PARENTS.items()},
        "seeds": len(cfg.protocol.seeds),
        "scenes": truth.baseline.shape[-1],
        "paths": cfg.intervene.paths,
        "placements": cfg.intervene.placements,
    }


def _symbol_study(model: Answers, truth: Answers) -> list[dict]:
    """The second inequality: do(Z_I := E(I + o)), a cell per (user, symbol)."""
    after = np.moveaxis(over_placements(model.intervened), 2, 1)  # (user, symbol, seed, scene)
    true_after = over_placements(truth.intervened)  # (user, symbol, scene)
    before = np.broadcast_to(model.baseline[:, None], after.shape)
    true_before = np.broadcast_to(truth.baseline[:, None], true_after.shape)
    return study(*(_cells(a) for a in (before, after, true_before, true_after)))


def _user_study(users: list[str], model: Answers, truth: Answers) -> list[dict]:
    """The first inequality: do(S := s'), a cell per ordered pair of users."""
    here, there = np.array([[users.index(u), users.index(o)] for u, o in ordered_pairs(users)]).T
    return study(model.baseline[here], model.baseline[there], truth.baseline[here], truth.baseline[there])


def _cells(values: np.ndarray) -> np.ndarray:
    return values.reshape(-1, *values.shape[2:])  # (user * symbol, ...)


if __name__ == "__main__":
    launch(main, "intervene")
