"""Stage perception: find the items in composites, on families of table tops that the segmenter was taught and others.

It judges the segmenter, without and with a picture of the empty table, by the items it finds, and by the accuracy of
stage clearance's models, which were fitted in the drawn world. On path-traced tables it also judges their verdicts on
added items. The truth is that of the users' rules on true footprints.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig
from scipy.optimize import linear_sum_assignment
from torch import Tensor
from tqdm import tqdm

from making.render.read import Rendered, read_rendered
from making.segmenter.composites import FAMILIES, draw_arrangements, draw_composites, read_palette
from pipeline.artifacts.demos import read_queries
from pipeline.artifacts.files import write_json, write_table
from pipeline.artifacts.scenes import read_position_prior, read_scenes
from pipeline.causal import interventions
from pipeline.launch import launch
from pipeline.models.base import ValidityModel, to_tensor
from pipeline.models.baselines import position_only
from pipeline.models.clearance.clearance import pack
from pipeline.models.trained import load_model
from pipeline.perception.empty import empty_table
from pipeline.perception.objects import SUPERSAMPLING, Objects, detect_objects, fit_capsule
from pipeline.runtime.errors import InputError
from pipeline.runtime.parallel import map_jobs
from pipeline.runtime.settings import Count, Group, Some, StudyGroup, Whole, need, need_one
from pipeline.runtime.streams import stream
from pipeline.stats.scores import DECISION
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SIDE, point_segment_distance
from pipeline.world.rules import valid

DETECTORS: dict[str, Callable[[Tensor, Tensor], Objects]] = {  # of images, and of the empty tables
    "segmenter": lambda images, empty: detect_objects(images, looks=True),
    "segmenter_empty": lambda images, empty: detect_objects(images, empty, looks=True),
}
BLIND = "position_only"  # the image-blind baseline, in place of a detector
VARIANT = "clearance"
DRAWN = ("val_scenes", "val_items")  # pools of the drawn world: items known from training, and others
ALL = "all"  # stands for every table top, or for the mean over users
FOUND_IOU = 0.5  # intersection over union from which an item counts as found
MIN_VISIBLE_PX = 12  # items with fewer visible pixels are neither asked for nor made up
FINE = 2  # points per pixel along each axis on which areas are compared

Models = Mapping[tuple[str, int], ValidityModel]  # by user and seed


class Headlines(Group):
    """The splits behind the accuracies of transfer.clearance in metrics.json."""

    taught_tops: str
    held_out_tops: str


class Settings(StudyGroup):
    pictures: Count
    arrangements: Count
    folder: str
    rendered: Some
    headlines: Headlines
    paths: Count
    root_seed: Whole


def agree(study: Settings, parameters: Any) -> None:
    """Reject headlines on splits that are not judged, and parameters without the variant that is."""
    for name, split in study.headlines:
        need_one(f"studies.perception.headlines.{name}", split, study.rendered)
    need(VARIANT in parameters.variants, "variants", list(parameters.variants), f"{VARIANT} among them")


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write families.csv and summary.csv of composites, and arrangements.csv.

    Of clearance models, write accuracy.csv, verdicts.csv and metrics.json.
    """
    study = cfg.studies.perception
    items, arranged = on_families(cfg)
    write_table(out_dir / "families.csv", recall(items, ["kind", "family", "detector"]))
    write_table(out_dir / "summary.csv", recall(items, ["kind", "detector"]))
    write_table(out_dir / "arrangements.csv", recall(arranged, ["kind", "detector"]))
    parts = map_jobs(partial(on_tables, cfg), list(study.rendered), cfg.workers, "path-traced splits")
    right, verdicts = (pd.concat(tables, ignore_index=True) for tables in zip(*parts, strict=True))
    accuracy = mean_accuracy(pd.concat([baselines(cfg), right], ignore_index=True))
    write_table(out_dir / "accuracy.csv", accuracy)
    write_table(out_dir / "verdicts.csv", verdicts)
    shown = headlines(study.headlines, accuracy, verdicts)
    write_json(out_dir / "metrics.json", {"transfer": {"clearance": shown}})


# Composites: which items are found


def on_families(cfg: DictConfig) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the items of new composites with the overlap of each detector's object, and those of arrangements.

    Arrangements are of one table of each family under a fixed camera, by how the empty table is known.
    """
    study, palette = cfg.studies.perception, read_palette(cfg.paths.data)
    on_composites, on_arrangements = [], []
    for family in tqdm(FAMILIES, desc="families"):
        key = {"kind": FAMILIES[family].kind, "family": family}
        drawn = draw_composites(stream(study.root_seed, "perception", family), study.pictures, [family], palette)
        objects = {name: detect(to_tensor(drawn.images), to_tensor(drawn.empty)) for name, detect in DETECTORS.items()}
        on_composites += [found_items(x, drawn.instances).assign(**key, detector=name) for name, x in objects.items()]
        drawn = draw_arrangements(stream(study.root_seed, "arrangements", family), study.arrangements, family, palette)
        taken = empty_table(drawn.images)
        tables = {"segmenter": None, "segmenter_empty": drawn.empty, "segmenter_pictures": None}
        if taken is not None and taken.is_useful:
            tables["segmenter_pictures"] = np.repeat(taken.canvas[None], len(drawn.images), 0)
        for name, empty in tables.items():
            found = detect_objects(to_tensor(drawn.images), None if empty is None else to_tensor(empty))
            on_arrangements.append(found_items(found, drawn.instances).assign(**key, detector=name))
    return pd.concat(on_composites, ignore_index=True), pd.concat(on_arrangements, ignore_index=True)


def found_items(objects: Objects, instances: UInt8[Array, "scene row column"]) -> pd.DataFrame:
    """Return a row for each item with its `iou`, and one with item -1 for each object that is none.

    Objects get the assignment with the largest sum of intersections over unions. They are capsules, so an item counts
    as the capsule fitted to its true pixels.
    """
    found = []
    for scene, truth in enumerate(instances):
        items = [i for i in range(1, truth.max() + 1) if (truth == i).sum() >= MIN_VISIBLE_PX]
        present = np.flatnonzero(objects.present[scene])
        capsules = [covered(objects.ends[scene, k], objects.radius[scene, k]) for k in present]
        true = [_true_capsule(truth == i) for i in items]
        iou = np.array([[_iou(a, b) for b in capsules] for a in true]).reshape(len(items), len(capsules))
        matched = linear_sum_assignment(-iou)
        best = np.zeros(len(items))
        best[matched[0]] = iou[matched]
        small = (truth > 0) & ~np.isin(truth, items)  # objects on the rest of a hidden item are no error
        fine_small = small.repeat(FINE, 0).repeat(FINE, 1)
        used = matched[1][iou[matched] > 0]
        made_up = sum(k not in used and not (c & fine_small).any() for k, c in enumerate(capsules))
        found += [{"scene": scene, "item": i, "iou": x} for i, x in zip(items, best, strict=True)]
        found += [{"scene": scene, "item": -1, "iou": 0.0}] * made_up
    return pd.DataFrame(found, columns=["scene", "item", "iou"])


def covered(ends: Float[Array, "2 2"], radius: float) -> Bool[Array, "fine_row fine_column"]:
    """Return the points of the finer grid inside a capsule [m]."""
    place = (np.arange(SIDE * FINE) + 0.5) / (SIDE * FINE)
    points = np.stack(np.meshgrid(place, 1 - place), -1)
    return point_segment_distance(points, ends[0], ends[1]) < radius


def _true_capsule(mask: Bool[Array, "row column"]) -> Bool[Array, "fine_row fine_column"]:
    """Return the points inside the capsule fitted to an item's pixels."""
    rows, columns = np.nonzero(mask.repeat(SUPERSAMPLING, 0).repeat(SUPERSAMPLING, 1))
    points = np.stack([columns + 0.5, SIDE * SUPERSAMPLING - rows - 0.5], -1) / (SIDE * SUPERSAMPLING)
    capsule = fit_capsule(points, SIDE * SUPERSAMPLING)
    return covered(np.stack([capsule.centre - capsule.half, capsule.centre + capsule.half]), capsule.radius)


def _iou(a: Bool[Array, "row column"], b: Bool[Array, "row column"]) -> float:
    return float((a & b).sum() / max((a | b).sum(), 1))


def recall(items: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    """Return recall, mean IoU of the items found, and objects made up for each item there is."""
    rows = []
    for key, group in items.groupby(keys, sort=False):
        iou = group.loc[group["item"] >= 0, "iou"]
        found, items = iou[iou >= FOUND_IOU], len(iou) or np.nan  # a few pictures may hold no item
        row = dict(zip(keys, key, strict=True)) | {"items": len(iou), "recall": len(found) / items}
        rows.append(row | {"iou": found.mean(), "made_up": (group["item"] < 0).sum() / items})
    return pd.DataFrame(rows)


# Clearance models: what perception changes for them


def trained(cfg: DictConfig) -> Models:
    """Return stage clearance's models of the judged users and the protocol's seeds."""
    keys = [(user, seed) for user in cfg.evaluate.users for seed in cfg.protocol.seeds]
    return {(user, seed): load_model(cfg, VARIANT, user, seed, cfg.main_n_demos) for user, seed in keys}


def baselines(cfg: DictConfig) -> pd.DataFrame:
    """Return the accuracies of clearance models in drawn scenes, and those of the image-blind baseline everywhere."""
    prior, models = read_position_prior(Path(cfg.paths.scenes)), trained(cfg)
    scenes, queries = read_scenes(Path(cfg.paths.scenes)), read_queries(Path(cfg.paths.demos))
    blind = [(user, 0) for user in cfg.evaluate.users]
    parts = []
    for pool in DRAWN:
        seen, asked = pack(**vars(detect_objects(to_tensor(scenes.images[pool]), looks=True))), queries[pool]
        p = [probability(model, seen, asked.z) for model in models.values()]
        parts.append(accuracies(models, p, asked.valid).assign(source=pool, top=ALL, detector="segmenter"))
        p = [position_only(prior[user], asked.z) for user, _ in blind]
        parts.append(accuracies(blind, p, asked.valid).assign(source=pool, top=ALL, detector=BLIND))
    for split in cfg.studies.perception.rendered:
        tables, z = tables_and_paths(cfg, split)
        true = {user: valid(tables.layouts, z, cfg.users[user]) for user in cfg.evaluate.users}
        part = accuracies(blind, [position_only(prior[user], z) for user, _ in blind], true)
        parts.append(part.assign(source=split, top=[tables.tops[i] for i in part["scene"]], detector=BLIND))
    return pd.concat(parts, ignore_index=True)


def tables_and_paths(cfg: DictConfig, split: str) -> tuple[Rendered, Float[Array, "scene path 2"]]:
    """Return a path-traced split and the random paths [m] that are judged in its scenes."""
    study = cfg.studies.perception
    tables = read_rendered(Path(study.folder) / split)
    return tables, random_z_theta(stream(study.root_seed, "paths", split), len(tables.images), study.paths)


def accuracies(
    keys: Iterable[tuple[str, int]], p: Iterable[Float[Array, "scene n"]], true: Mapping[str, Bool[Array, "scene n"]]
) -> pd.DataFrame:
    """Return a row for each user and seed, with its P(valid), and scene: the share of paths judged right."""
    parts = []
    for (user, seed), each in zip(keys, p, strict=True):
        right = ((each > DECISION) == true[user]).mean(1)
        parts.append(pd.DataFrame({"user": user, "seed": seed, "scene": range(len(right)), "accuracy": right}))
    return pd.concat(parts, ignore_index=True)


@torch.no_grad()
def probability(
    model: ValidityModel, seen: Float[Tensor, "scene object column"], z: Float[Array, "scene path 2"]
) -> Float[Array, "scene path"]:
    """Return P(valid) of each path [m] among the objects seen."""
    return model.logit(seen, torch.from_numpy(z).float()).sigmoid().numpy()


def mean_accuracy(rows: pd.DataFrame) -> pd.DataFrame:
    """Return mean accuracies with quartiles over seeds, by source, table top (or all), detector and user (or all)."""
    rows = pd.concat([rows, rows[rows["top"] != ALL].assign(top=ALL)])
    rows, key = pd.concat([rows, rows.assign(user=ALL)]), ["source", "top", "detector", "user"]
    by_seed = rows.groupby([*key, "seed"], sort=False).agg(accuracy=("accuracy", "mean"), scenes=("scene", "nunique"))
    groups = by_seed.groupby(key, sort=False)
    means = groups.agg(seeds=("scenes", "size"), scenes=("scenes", "first"), accuracy=("accuracy", "mean"))
    q1, q3 = (groups["accuracy"].quantile(share) for share in (0.25, 0.75))
    return means.assign(q1=q1, q3=q3).reset_index()


def on_tables(cfg: DictConfig, split: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the results on one split: rows of `accuracies`, and `interventions.verdicts` for each user and symbol.

    Raise InputError if it has no pictures with an added item.
    """
    users, (tables, z) = list(cfg.evaluate.users), tables_and_paths(cfg, split)
    if not tables.with_item:
        leave = "leave this split out of studies.perception.rendered"
        raise InputError(f"{cfg.studies.perception.folder}/{split} has no pictures with an added item: {leave}")
    layouts = [tables.layouts, *tables.layouts_with_item.values()]
    true = np.stack([[valid(x, z, cfg.users[user]) for x in layouts] for user in users])
    models, rows, judged = trained(cfg), [], []
    for detector, detect in DETECTORS.items():
        key, empty = {"source": split, "detector": detector}, to_tensor(tables.empty)
        seen = [pack(**vars(detect(to_tensor(x), empty))) for x in (tables.images, *tables.with_item.values())]
        p = np.stack([[probability(model, x, z) for x in seen] for model in models.values()])
        right = accuracies(models, p[:, 0], dict(zip(users, true[:, 0], strict=True)))
        rows.append(right.assign(top=[tables.tops[i] for i in right["scene"]], **key))
        verdicts = interventions.verdicts(users, p.reshape(len(users), -1, *p.shape[1:]), true, layouts)
        judged.append(verdicts.assign(**key))
    return pd.concat(rows, ignore_index=True), pd.concat(judged, ignore_index=True)


def headlines(headlines: Mapping[str, str], accuracy: pd.DataFrame, verdicts: pd.DataFrame) -> dict[str, float]:
    """Return accuracy on each headline's split, and the right verdicts on the split with fewer of them.

    Without the empty table's picture; accuracy: of `mean_accuracy`, means over users.
    """
    of_segmenter = accuracy.query("detector == 'segmenter' and user == 'all' and top == 'all'").set_index("source")
    right = verdicts.query("detector == 'segmenter'").groupby("source")["right"].sum()
    shown = {name: float(of_segmenter.loc[split, "accuracy"]) for name, split in headlines.items()}
    return shown | {"verdicts_right": int(right[list(headlines.values())].min())}


if __name__ == "__main__":
    launch(main, "perception")
