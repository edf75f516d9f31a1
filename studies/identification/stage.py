"""Stage identification: identify the user behind labelled paths in new scenes.

Every variant is compared with the ideal observer and with an image-blind baseline.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig

from pipeline.artifacts.files import write_table
from pipeline.artifacts.scenes import read_position_prior, read_scenes
from pipeline.causal.identify import all_distinct, distinct_from, identify, reject_all_users
from pipeline.launch import launch
from pipeline.models import baselines
from pipeline.models.baselines import POSITION
from pipeline.models.trained import check_weights, predict_all
from pipeline.runtime.errors import InputError
from pipeline.runtime.streams import stream
from pipeline.stats.crossed import estimate
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS
from pipeline.world.rules import valid

CERTAIN_FLOOR = 1e-6  # clipping of probabilities that are known, not learned
IDEAL, ALL, STRANGER = "ideal", "all", "stranger"  # names of the variant and of the users in the tables


@dataclass(frozen=True)
class Demonstrations:
    """Labelled paths in every scene, the same for all users and models: labels by each user, and by the stranger."""

    images: np.ndarray  # uint8 (scene, 100, 100, 3)
    z_theta: np.ndarray  # (scene, draw * path, 2) [m]
    valid: np.ndarray  # bool (user, scene, draw, path)
    valid_to_stranger: np.ndarray  # bool (scene, draw, path)


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write curve.csv, summary.csv and open_set.csv."""
    check_weights(cfg)
    study, users, shown = cfg.studies.identification, list(cfg.users), draw_demonstrations(cfg)

    # P(valid) of every path by each variant's model of each user: (user, seed, scene, draw, path)
    predictions = predict_all(cfg, users, shown.images, shown.z_theta, "identification")
    observers = {variant: by_draw(cfg, p) for variant, p in predictions.items()}
    observers[POSITION] = by_draw(cfg, position_only(cfg, shown.z_theta))
    observers[IDEAL] = shown.valid[:, None].astype(float)
    n_labels = cfg.scenes.per_seed * cfg.main_n_demos  # number of labels that a model was fitted to
    learned_floor = 1 / (n_labels + 2)  # Laplace: n labels support no more certainty than (n + 1) / (n + 2)

    distinct = all_distinct(shown.valid)
    stranger_distinct = distinct_from(shown.valid_to_stranger, shown.valid)
    demonstrators = np.concatenate([shown.valid, shown.valid_to_stranger[None]])
    curves, open_set = [], []
    for variant, p in observers.items():
        floor = learned_floor if variant in cfg.variants else CERTAIN_FLOOR
        correct, confidence = identify(p, shown.valid, floor)  # (user, path, seed, scene)
        for user, c, sure in [
            *zip(users, correct, confidence, strict=True),
            (ALL, correct.mean(0), confidence.mean(0)),
        ]:
            curve = rate(c) | rate(c, "distinct_", distinct) | {"confidence": sure.mean((1, 2))}
            curves.append(by_path(variant, user, "accuracy", curve))
        rejected = reject_all_users(p, demonstrators, floor, study.level)
        everyone = np.ones_like(distinct)
        for user, r, scenes in [
            *((user, r, distinct) for user, r in zip(users, rejected[:-1], strict=True)),
            (ALL, rejected[:-1].mean(0), distinct),
            (STRANGER, rejected[-1], stranger_distinct),
        ]:
            open_set.append(by_path(variant, user, "rejected", rate(r, scenes=everyone) | rate(r, "distinct_", scenes)))
    curve = pd.concat(curves, ignore_index=True)
    summary = curve[(curve["user"] == ALL) & curve["k"].isin(study.reported)].drop(columns="user")
    counts = {"scenes": len(distinct), "distinct_scenes": int(distinct.sum()), "chance": 1 / len(users)}
    write_table(out_dir / "curve.csv", curve)
    write_table(out_dir / "summary.csv", summary.assign(**counts))
    write_table(out_dir / "open_set.csv", pd.concat(open_set, ignore_index=True))


def draw_demonstrations(cfg: DictConfig) -> Demonstrations:
    """Draw the paths of every scene and label them by the rules of each user and of the stranger."""
    study, scenes = cfg.studies.identification, read_scenes(Path(cfg.paths.scenes))
    pool = cfg.protocol.splits[study.split]
    scenes.check_has(pool)
    layouts = scenes.layouts[pool]
    z_theta = random_z_theta(stream(study.root_seed, "identify"), len(layouts), study.draws * study.paths)
    stranger = {symbol: study.stranger.get(symbol) for symbol in SYMBOLS}
    labels = by_draw(cfg, np.stack([valid(layouts, z_theta, margins) for margins in cfg.users.values()]))
    return Demonstrations(scenes.images[pool], z_theta, labels, by_draw(cfg, valid(layouts, z_theta, stranger)))


def by_draw(cfg: DictConfig, values: np.ndarray) -> np.ndarray:
    """Return values (..., draw * path) as (..., draw, path)."""
    study = cfg.studies.identification
    return values.reshape(*values.shape[:-1], study.draws, study.paths)


def position_only(cfg: DictConfig, z_theta: np.ndarray) -> np.ndarray:
    """Return each user's mean validity by position, without the image: (user, 1, scene, path)."""
    prior = read_position_prior(Path(cfg.paths.scenes))
    if unknown := set(cfg.users) - set(prior):
        raise InputError(f"position_prior.npz has no user {', '.join(sorted(unknown))}: run the scenes stage again")
    return np.stack([baselines.position_only(prior[user], z_theta) for user in cfg.users])[:, None]


def rate(values: np.ndarray, prefix: str = "", scenes: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Return the mean of (path, seed, scene) over seeds and the chosen scenes, and its 95 % interval within [0, 1].

    NaN for fewer than two scenes.
    """
    chosen = values if scenes is None else values[..., scenes]
    if chosen.shape[-1] < 2:
        none = np.full(len(values), np.nan)
        return {f"{prefix}rate": none, f"{prefix}ci_low": none, f"{prefix}ci_high": none}
    e = estimate(chosen)
    ends = {f"{prefix}ci_low": e.ci_low.clip(0, 1), f"{prefix}ci_high": e.ci_high.clip(0, 1)}
    return {f"{prefix}rate": e.effect} | ends


def by_path(variant: str, user: str, name: str, columns: Mapping[str, np.ndarray]) -> pd.DataFrame:
    """Return one row per number k of paths; the columns of `rate` are renamed with `name`."""
    table = pd.DataFrame(dict(columns)).rename(columns={"rate": name, "distinct_rate": f"distinct_{name}"})
    return pd.DataFrame({"variant": variant, "user": user, "k": 1 + np.arange(len(table))}).join(table)


if __name__ == "__main__":
    launch(main, "identification")
