"""Accuracy of clearance models by the detector that shows them the objects, drawn and path-traced."""

from collections.abc import Callable
from pathlib import Path

import pandas as pd
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from torch import Tensor

from pipeline.artifacts.demos import demo_arrays, read_labelled
from pipeline.artifacts.scenes import SceneSet, train_pool
from pipeline.models.base import to_tensor, untrained
from pipeline.models.clearance.clearance import ClearanceModel, pack
from pipeline.perception.objects import Objects
from pipeline.runtime.streams import job_seed, stream
from pipeline.stats.scores import DECISION
from pipeline.training.clearance.fit import fit
from pipeline.training.loop import Schedule
from pipeline.world.bezier import random_z_theta
from pipeline.world.rules import valid
from rendered.read import read_rendered
from studies.perception import finder

Detector = Callable[[Tensor, Tensor], Objects]  # images, and the empty tables
VARIANT = "clearance"
DRAWN = ("val_scenes", "val_items")  # pools of the drawn world: items known from training, and others


class FinderModel(ClearanceModel):
    """A clearance model that sees what the hand-tuned finder detects."""

    def perceive(self, images: Float[Tensor, "scene 3 100 100"]) -> Float[Tensor, "scene object 13"]:
        """Return the detected objects, packed as by `PerceivedObjects.percept`."""
        return percept(finder.detect_objects(images))


def percept(objects: Objects) -> Float[Tensor, "scene object 13"]:
    """Return objects packed as a clearance model sees them."""
    start, end = torch.from_numpy(objects.ends).unbind(-2)
    radius, features, present = map(torch.from_numpy, (objects.radius, objects.features, objects.present))
    return pack(start, end, radius, features, present)


def accuracies(cfg: DictConfig, detectors: dict[str, Detector]) -> pd.DataFrame:
    """Return a row for each source, kind of table top, detector, user, seed and scene: the share of paths judged right.

    Sources are the drawn world's validation scenes, and path-traced splits with and without the empty table's picture.
    Models are fitted in the drawn world, to what the finder or the segmenter sees without that picture.
    """
    study = cfg.studies.perception
    scenes, demos, queries = read_labelled(cfg.paths.scenes, cfg.paths.demos)
    models = {kind: _fitted(cfg, kind, scenes, demos) for kind in (FinderModel, ClearanceModel)}
    rows = []

    def judge(source: str, tops: list[str], name: str, seen: Tensor, z: Array, true: dict[str, Array]) -> None:
        for (seed, user), model in models[FinderModel if name == "finder" else ClearanceModel].items():
            right = _judged(model, seen, z) == true[user]
            columns = {"scene": range(len(z)), "top": tops, "accuracy": right.mean(1)}
            rows.append(pd.DataFrame(columns).assign(source=source, detector=name, user=user, seed=seed))

    for pool in DRAWN:
        images, tops, asked = to_tensor(scenes.images[pool]), ["drawn"] * len(scenes.images[pool]), queries[pool]
        for name in ("finder", "segmenter"):
            judge(pool, tops, name, percept(detectors[name](images, images)), asked.z, asked.valid)
    for split in study.rendered:
        tables = read_rendered(Path(study.folder) / split)
        z = random_z_theta(stream(study.root_seed, "paths", split), len(tables.images), study.paths)
        true = {user: valid(tables.layouts, z, cfg.users[user]) for user in cfg.evaluate.users}
        for name, detect in detectors.items():
            seen = percept(detect(to_tensor(tables.images), to_tensor(tables.empty)))
            judge(split, tables.tops, name, seen, z, true)
    return pd.concat(rows, ignore_index=True)


def _fitted(
    cfg: DictConfig, kind: type[ClearanceModel], scenes: SceneSet, demos: pd.DataFrame
) -> dict[tuple[int, str], ClearanceModel]:
    """Return a model of each validation seed and judged user, fitted in the drawn world."""
    keys = [(seed, user) for seed in cfg.validation_seeds for user in cfg.evaluate.users]
    seeds = [job_seed(seed, user, cfg.main_n_demos, VARIANT) for seed, user in keys]
    models = [untrained(kind, cfg.variants[VARIANT].model, seed) for seed in seeds]
    images = [scenes.images[train_pool(seed)] for seed, _ in keys]
    z, labels = zip(*(demo_arrays(demos, seed, user, cfg.main_n_demos) for seed, user in keys), strict=True)
    fit(models, images, z, labels, Schedule.of(cfg.clearance), seeds)  # pyright: ignore
    return dict(zip(keys, models, strict=True))  # pyright: ignore


@torch.no_grad()
def _judged(model: ClearanceModel, seen: Tensor, z: Array) -> Array:
    """Return whether each path is judged valid: (scene, path)."""
    return model.logit(seen, torch.from_numpy(z).float()).sigmoid().numpy() > DECISION
