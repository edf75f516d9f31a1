"""Accuracy on the drawn world's validation scenes, and the image-blind baseline everywhere."""

from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import torch
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from torch import Tensor

from making.render.read import Rendered, read_rendered
from pipeline.artifacts.demos import read_queries
from pipeline.artifacts.scenes import read_position_prior, read_scenes
from pipeline.models.base import ValidityModel, to_tensor
from pipeline.models.baselines import position_only
from pipeline.models.clearance.clearance import pack
from pipeline.models.trained import load_model
from pipeline.perception.objects import Objects, detect_objects
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import random_z_theta
from pipeline.world.rules import valid

Models = Mapping[tuple[str, int], ValidityModel]  # by user and seed
VARIANT = "clearance"
DRAWN = ("val_scenes", "val_items")  # pools of the drawn world: items known from training, and others
BLIND = "position_only"  # the image-blind baseline, in place of a detector
ALL = "all"  # stands for every table top, or for the mean over users


def percept(objects: Objects) -> Float[Tensor, "scene object 14"]:
    """Return objects packed as a clearance model sees them."""
    start, end = torch.from_numpy(objects.ends).unbind(-2)
    radius, features, present = map(torch.from_numpy, (objects.radius, objects.features, objects.present))
    return pack(start, end, radius, features, present, torch.from_numpy(objects.doubt))


def trained(cfg: DictConfig) -> Models:
    """Return stage clearance's models of the judged users and the protocol's seeds."""
    keys = [(user, seed) for user in cfg.evaluate.users for seed in cfg.protocol.seeds]
    return {(user, seed): load_model(cfg, VARIANT, user, seed, cfg.main_n_demos) for user, seed in keys}


def accuracies(cfg: DictConfig) -> pd.DataFrame:
    """Return a row for each source, detector, user, seed and scene (`judged`).

    Stage clearance's models are judged on drawn scenes, and the image-blind baseline everywhere.
    """
    prior, models = read_position_prior(Path(cfg.paths.scenes)), trained(cfg)
    scenes, queries = read_scenes(Path(cfg.paths.scenes)), read_queries(Path(cfg.paths.demos))
    parts = []
    for pool in DRAWN:
        seen, asked = percept(detect_objects(to_tensor(scenes.images[pool]))), queries[pool]
        part = judged(models, seen, asked.z, asked.valid)
        parts.append(part.assign(source=pool, top=ALL, detector="segmenter"))
        parts.append(judged_blind(cfg, prior, asked.z, asked.valid).assign(source=pool, top=ALL, detector=BLIND))
    for split in cfg.studies.perception.rendered:
        tables, z = tables_and_paths(cfg, split)
        true = {user: valid(tables.layouts, z, cfg.users[user]) for user in cfg.evaluate.users}
        part = judged_blind(cfg, prior, z, true)
        parts.append(part.assign(source=split, top=[tables.tops[i] for i in part["scene"]], detector=BLIND))
    return pd.concat(parts, ignore_index=True)


def tables_and_paths(cfg: DictConfig, split: str) -> tuple[Rendered, Float[Array, "scene path 2"]]:
    """Return a path-traced split and the random paths [m] that are judged in its scenes."""
    study = cfg.studies.perception
    tables = read_rendered(Path(study.folder) / split)
    return tables, random_z_theta(stream(study.root_seed, "paths", split), len(tables.images), study.paths)


def judged(
    models: Models,
    seen: Float[Tensor, "scene object column"],
    z: Float[Array, "scene path 2"],
    true: Mapping[str, Bool[Array, "scene path"]],
) -> pd.DataFrame:
    """Return a row for each user, seed and scene: the share of paths judged right."""
    rows = []
    for (user, seed), model in models.items():
        right = (probability(model, seen, z) > DECISION) == true[user]
        rows.append(pd.DataFrame({"user": user, "seed": seed, "scene": range(len(z)), "accuracy": right.mean(1)}))
    return pd.concat(rows, ignore_index=True)


def judged_blind(
    cfg: DictConfig,
    prior: Mapping[str, Float[Array, "side side"]],
    z: Float[Array, "scene path 2"],
    true: Mapping[str, Bool[Array, "scene path"]],
) -> pd.DataFrame:
    """Return a row for each user and scene: the share of paths that their position alone judges right, as seed 0."""
    rows = []
    for user in cfg.evaluate.users:
        right = (position_only(prior[user], z) > DECISION) == true[user]
        rows.append(pd.DataFrame({"user": user, "seed": 0, "scene": range(len(z)), "accuracy": right.mean(1)}))
    return pd.concat(rows, ignore_index=True)


@torch.no_grad()
def probability(
    model: ValidityModel, seen: Float[Tensor, "scene object column"], z: Float[Array, "scene path 2"]
) -> Float[Array, "scene path"]:
    """Return P(valid) of each path [m] among the objects seen."""
    return model.logit(seen, torch.from_numpy(z).float()).sigmoid().numpy()


def summarised(rows: pd.DataFrame) -> pd.DataFrame:
    """Return mean accuracies with quartiles over seeds, by source, table top (or all), detector and user (or all)."""
    rows = pd.concat([rows, rows[rows["top"] != ALL].assign(top=ALL)])
    rows = pd.concat([rows, rows.assign(user=ALL)])
    key = ["source", "top", "detector", "user"]
    by_seed = rows.groupby([*key, "seed"], sort=False).agg(accuracy=("accuracy", "mean"), scenes=("scene", "nunique"))
    groups = by_seed.reset_index().groupby(key, sort=False)
    quartiles = {name: groups["accuracy"].quantile(q) for name, q in (("q1", 0.25), ("q3", 0.75))}
    means = groups.agg(seeds=("seed", "size"), scenes=("scenes", "first"), accuracy=("accuracy", "mean"))
    return means.assign(**quartiles).reset_index()
