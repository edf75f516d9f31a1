"""Stage perception: find the items in composites, on families of table tops that the segmenter was taught and others.

It judges the segmenter, without and with a picture of the empty table, by the items it finds, and by the accuracy of
clearance models. On path-traced tables it also judges the models' verdicts on added items, and the search for the
nearest valid path.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from omegaconf import DictConfig
from torch import Tensor
from tqdm import tqdm

from making.segmenter.composites import draw_composites, read_palette
from making.segmenter.tops import FAMILIES
from pipeline.artifacts.files import write_arrays, write_json, write_table
from pipeline.launch import launch
from pipeline.models.base import to_tensor
from pipeline.perception.objects import Objects, detect_objects
from pipeline.runtime.streams import stream
from studies.perception.accuracy import accuracies, summarised
from studies.perception.measure import FOUND_IOU, match
from studies.perception.transfer import headlines, transfer

DETECTORS: dict[str, Callable[[Tensor, Tensor], Objects]] = {  # of images, and of the empty tables
    "segmenter": lambda images, empty: detect_objects(images),
    "segmenter_empty": detect_objects,
}
SHOWN = 1  # pictures of each family in examples.npz


def main(cfg: DictConfig, out_dir: Path) -> None:
    """Write items.parquet (a row an item and detector), families.csv, summary.csv and examples.npz of composites.

    Of clearance models, write accuracy.csv, verdicts.csv, search.csv and metrics.json.
    """
    study = cfg.studies.perception
    palette = read_palette(cfg.paths.data)
    parts, examples = [], {}
    for family in tqdm(FAMILIES, desc="families"):
        rng = stream(study.root_seed, "perception", family)
        composites = draw_composites(rng, study.pictures, [family], palette)
        images, empty = to_tensor(composites.images), to_tensor(composites.empty)
        for name, detect in DETECTORS.items():
            objects = detect(images, empty)
            table = judged(objects, composites.instances)
            parts.append(table.assign(kind=FAMILIES[family].kind, family=family, detector=name))
            if name != "segmenter_empty":
                examples[f"{family}.{name}.ends"] = objects.ends[:SHOWN]
                examples[f"{family}.{name}.radius"] = np.where(objects.present, objects.radius, np.nan)[:SHOWN]
        examples[f"{family}.image"] = composites.images[:SHOWN]
    items = pd.concat(parts, ignore_index=True)
    write_table(out_dir / "items.parquet", items)
    write_table(out_dir / "families.csv", summary(items, ["kind", "family", "detector"]))
    write_table(out_dir / "summary.csv", summary(items, ["kind", "detector"]))
    write_arrays(out_dir / "examples.npz", examples)
    on_tables = transfer(cfg)
    accuracy = summarised(pd.concat([accuracies(cfg), on_tables.accuracy], ignore_index=True))
    write_table(out_dir / "accuracy.csv", accuracy)
    write_table(out_dir / "verdicts.csv", on_tables.verdicts)
    write_table(out_dir / "search.csv", on_tables.search)
    write_json(
        out_dir / "metrics.json",
        {"transfer": {"clearance": headlines(study.headlines, accuracy, on_tables.verdicts)}},
    )


def judged(objects: Objects, instances: np.ndarray) -> pd.DataFrame:
    """Return a row for each item with its `iou`, and one with item -1 for each object that is none."""
    rows = []
    for scene, truth in enumerate(instances):
        matches = match(objects, scene, truth)
        rows += [{"scene": scene, "item": i, "iou": x} for i, x in zip(matches.item, matches.iou, strict=True)]
        rows += [{"scene": scene, "item": -1, "iou": 0.0}] * matches.made_up
    return pd.DataFrame(rows, columns=["scene", "item", "iou"])


def summary(items: pd.DataFrame, keys: list[str]) -> pd.DataFrame:
    """Return recall, mean IoU of the items found, and objects made up for each item there is."""
    rows = []
    for key, group in items.groupby(keys, sort=False):
        iou = group.loc[group["item"] >= 0, "iou"]
        found, items = iou[iou >= FOUND_IOU], len(iou) or np.nan  # a few pictures may hold no item
        row = dict(zip(keys, key, strict=True)) | {"items": len(iou), "recall": len(found) / items}
        rows.append(row | {"iou": found.mean(), "made_up": (group["item"] < 0).sum() / items})
    return pd.DataFrame(rows)


if __name__ == "__main__":
    launch(main, "perception")
