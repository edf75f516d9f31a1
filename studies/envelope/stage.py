"""Stage envelope: estimate the distance that each user keeps from each symbol, by every model.

The estimates are compared with the true margins.
"""

from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from omegaconf import DictConfig

from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import AddedItems, read_interventions, read_scenes, train_pool
from pipeline.causal.envelope import dose_grid, envelopes, paths_at_doses, response_curve
from pipeline.launch import launch
from pipeline.models.trained import check_weights, predict_all
from pipeline.planning.nearest import nearest_valid
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.runtime.writing import atomic_write
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import clearance, slack, valid

MAX_ROOM_M = 1.0  # upper limit on room, which is infinite for users without a margin
HEADER = """\
# Safety envelopes that model `{variant}` learned from labelled demonstrations: user -> symbol. Lengths in metres.
# keep_clear_m: distance that a path of this user should keep from the item's outline (the interval's upper end).
#   null means that no effect was found, or (verdict undecided) that it is not known: do not take it as leave to touch.
# radius_m, ci_low_m, ci_high_m: clearance at which half of the item's effect is gone, and its 95 % interval.
# response: how much touching the item takes from the chance that a path clear of all others is valid.
# Paths that keep these distances and no more are not always valid (planning.csv), so add a margin:
"""


@dataclass(frozen=True)
class Scenes:
    """The scenes without and with each added symbol, and random paths in them."""

    images: np.ndarray  # uint8 (scene, 100, 100, 3)
    layouts: Layouts
    added: AddedItems
    z_theta: np.ndarray  # (scene, candidate, 2) [m]
    n_training: list[int]  # number of items of each symbol in the training scenes of all seeds


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write envelope.csv, curve.parquet, planning.csv and specification.yaml."""
    check_weights(cfg)
    study, users, scenes = cfg.studies.envelope, list(cfg.users), read_inputs(cfg)

    # the same paths at each dose, in the scenes without and with the item
    doses = dose_grid(study.step, study.doses)
    chosen = choose_paths(cfg, scenes, doses)  # (symbol, scene, dose, path), -1: none
    flat = chosen.reshape(*chosen.shape[:2], -1)
    z_theta = np.take_along_axis(scenes.z_theta[None], flat[..., None], axis=2)  # (symbol, scene, dose * path, 2)
    true_response = true_responses(cfg, scenes, z_theta, chosen)  # (user, symbol, scene, dose)
    responses = model_responses(cfg, scenes, z_theta, chosen)  # variant -> (user, symbol, seed, scene, dose)

    questions = list(product(users, SYMBOLS))
    names = pd.DataFrame(questions, columns=["user", "symbol"])
    margins = [cfg.users[user][symbol] for user, symbol in questions]
    item = np.tile(scenes.added.item, (len(users), 1))  # (question, scene)
    truth = true_response.reshape(len(questions), *true_response.shape[2:])
    tables, curves = [], []
    for variant, response in [*responses.items(), ("truth", true_response[:, :, None])]:
        values = response.reshape(len(questions), *response.shape[2:])
        n_training = [None] * len(questions) if variant == "truth" else scenes.n_training * len(users)
        table = pd.concat([names, envelopes(values, item, n_training, margins, doses)], axis=1)
        table.insert(0, "variant", variant)
        tables.append(table)
        for q, (user, symbol) in enumerate(questions):
            curve = response_curve(values[q], truth[q], item[q], n_training[q], doses)
            curves.append(pd.DataFrame({"variant": variant, "user": user, "symbol": symbol} | dict(curve.items())))
    found = pd.concat(tables, ignore_index=True)
    write_table(out_dir / "envelope.csv", found)
    write_table(out_dir / "curve.parquet", pd.concat(curves, ignore_index=True))

    learned = found[found["variant"] == study.planner]
    planning = check_plans(cfg, scenes, learned)
    write_table(out_dir / "planning.csv", planning)
    write_specification(out_dir / "specification.yaml", study.planner, learned, planning)


def read_inputs(cfg: DictConfig) -> Scenes:
    """Read the scenes without and with added items, and draw the candidate paths."""
    study, pool = cfg.studies.envelope, cfg.protocol.splits[cfg.intervene.split]
    scenes = read_scenes(Path(cfg.paths.scenes))
    scenes.check_has(pool, *map(train_pool, cfg.protocol.seeds))
    images, layouts = scenes.images[pool], scenes.layouts[pool]
    added = read_interventions(Path(cfg.paths.intervene), layouts)
    if added.images.shape[1:] != images.shape:
        raise InputError(
            f"{cfg.paths.intervene}: images {added.images.shape} of added items, {images.shape} of the scenes {pool}: "
            "expected one for each scene and symbol; run the intervene stage again"
        )
    z_theta = random_z_theta(stream(study.root_seed, "envelope"), len(layouts), study.candidates)
    training = [scenes.layouts[train_pool(seed)] for seed in cfg.protocol.seeds]
    shown = [set(np.concatenate([x.item[x.symbol == s] for x in training])) for s in range(len(SYMBOLS))]
    return Scenes(images, layouts, added, z_theta, [max(1, len(items)) for items in shown])


def choose_paths(cfg: DictConfig, scenes: Scenes, doses: np.ndarray) -> np.ndarray:
    """Return the candidates at each dose, (symbol, scene, dose, path); -1 if a scene lacks the dose.

    InputError if a dose occurs with fewer than two items of a symbol.
    """
    study = cfg.studies.envelope
    to_others = scene_clearance(scenes.layouts, scenes.z_theta).min(-1)
    to_added = [scene_clearance(item, scenes.z_theta)[..., 0] for item in scenes.added.placed]
    chosen = np.stack([paths_at_doses(c, to_others, doses, study.clear_of_others, study.paths) for c in to_added])
    for symbol, item, has_dose in zip(SYMBOLS, scenes.added.item, chosen[..., 0] >= 0, strict=True):
        items = np.array([len(np.unique(item[scene])) for scene in has_dose.T])  # number of items by dose
        if items.min() < 2:
            raise InputError(
                f"{items.min()} items have {study.paths} paths {doses[items.argmin()]:.4f} m from an added {symbol} "
                "and in contact, in some scene: expected at least 2; raise studies.envelope.candidates, lower its "
                "doses, paths or clear_of_others, or intervene on more scenes"
            )
    return chosen


def scene_clearance(layouts: Layouts, z_theta: np.ndarray) -> np.ndarray:
    """Return the clearances [m] (scene, path, slot), one scene at a time to limit memory."""
    return np.concatenate([clearance(layouts[[i]], z_theta[[i]]) for i in range(len(layouts))])


def true_responses(cfg: DictConfig, scenes: Scenes, z_theta: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return the true response, (user, symbol, scene, dose)."""
    before = [[valid(scenes.layouts, z, m) for z in z_theta] for m in cfg.users.values()]
    after = [[valid(x, z, m) for x, z in zip(scenes.added.layouts, z_theta, strict=True)] for m in cfg.users.values()]
    return mean_loss(np.array(before, float), np.array(after, float), chosen)


def model_responses(cfg: DictConfig, scenes: Scenes, z_theta: np.ndarray, chosen: np.ndarray) -> dict[str, np.ndarray]:
    """Return each variant's response, (user, symbol, seed, scene, dose).

    Each original scene is perceived once, with the paths of all symbols.
    """
    users = list(cfg.users)
    has_dose = np.nonzero(chosen[:, :, 0, 0] >= 0)  # symbols and scenes with a path in contact, hence with any
    before = predict_all(cfg, users, scenes.images, np.concatenate(z_theta, axis=1), "envelope: as it is")
    after = predict_all(cfg, users, scenes.added.images[has_dose], z_theta[has_dose], "envelope: added item")
    responses = {}
    for variant in cfg.variants:
        p = before[variant].reshape(*before[variant].shape[:3], len(SYMBOLS), -1)  # (user, seed, scene, symbol, path)
        p_before = np.moveaxis(p, 3, 2)
        p_after = np.full_like(p_before, np.nan)
        p_after[:, :, *has_dose] = after[variant]
        responses[variant] = np.moveaxis(mean_loss(p_before, p_after, chosen), 2, 1)
    return responses


def mean_loss(before: np.ndarray, after: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Return the mean decrease of P(valid) over the paths at each dose: (..., symbol, scene, dose)."""
    loss = (before - after).reshape(*before.shape[:-1], *chosen.shape[2:]).mean(-1, dtype=np.float64)
    return np.where(chosen[..., 0] >= 0, loss, np.nan)


def check_plans(cfg: DictConfig, scenes: Scenes, learned: pd.DataFrame) -> pd.DataFrame:
    """Return how valid paths are after moving just far enough to keep the learned distances, one row per user.

    plans: number of paths that had to move and could; valid: share that is truly valid; shortfall_m: 99th percentile of
    the distance [m] that they miss. Only users with an envelope.
    """
    starts, rows = scenes.z_theta[:, : cfg.studies.envelope.starts], []
    for user, table in learned.groupby("user", sort=False):
        keep_clear = {s: None if np.isnan(x) else x for s, x in zip(table["symbol"], table["ci_high"], strict=True)}
        if all(distance is None for distance in keep_clear.values()):
            continue
        plans = nearest_valid(scenes.layouts, starts, keep_clear, cfg.repair.lattice_side, cfg.repair.refinements)
        moved = ~valid(scenes.layouts, starts, keep_clear) & valid(scenes.layouts, plans, keep_clear)
        room = slack(scenes.layouts, scene_clearance(scenes.layouts, plans), cfg.users[user])[moved]
        share, short = ((room > 0).mean(), -np.quantile(room.clip(max=MAX_ROOM_M), 0.01)) if len(room) else (np.nan, 0)
        rows.append({"user": user, "plans": len(room), "valid": share, "shortfall_m": max(0.0, short)})
    table = pd.DataFrame(rows, columns=["user", "plans", "valid", "shortfall_m"])
    table.insert(0, "variant", cfg.studies.envelope.planner)
    return table


def write_specification(path: Path, variant: str, learned: pd.DataFrame, planning: pd.DataFrame) -> None:
    """Write the planner's envelopes as YAML, with a header on their accuracy."""
    content: dict[str, dict] = {}
    for row in learned.to_dict("records"):
        lengths = {
            name: None if np.isnan(row[name]) else round(row[name], 4) for name in ("radius_m", "ci_low", "ci_high")
        }
        content.setdefault(row["user"], {})[row["symbol"]] = {
            "keep_clear_m": lengths["ci_high"],
            "radius_m": lengths["radius_m"],
            "ci_low_m": lengths["ci_low"],
            "ci_high_m": lengths["ci_high"],
            "response": round(row["response"], 4),
            "verdict": row["verdict"],
        }
    lines = [
        f"#   - {row.user}: {100 * row.valid:.1f} % of {row.plans} such paths are valid, and 99 % lack at most "
        f"{row.shortfall_m:.4f} m.\n"
        for row in planning.itertuples()
    ]
    text = HEADER.format(variant=variant) + "".join(lines) + yaml.safe_dump(content, sort_keys=True)
    atomic_write(path, lambda part: part.write_text(text))


if __name__ == "__main__":
    launch(main, "envelope")
