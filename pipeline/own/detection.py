"""Compare the detected objects with the items that a person listed."""

import pandas as pd

from pipeline.own.folder import Folder
from pipeline.own.kinds import Scenes
from pipeline.world.layout import point_segment_distance

NEAR_M = 0.01  # an item's centre may lie this far outside a detected outline [m of the model]


def detected(folder: Folder, scenes: Scenes) -> pd.DataFrame:
    """Return one row for each listed item: scene, kind, and whether a detected object covers its centre."""
    items = folder.items
    assert items is not None
    centres = folder.frame.to_model(items[["x", "y"]].to_numpy())
    hits = []
    for name, centre in zip(items["scene"], centres, strict=True):
        scene = scenes.names.index(name)
        present = scenes.objects.present[scene]
        ends = scenes.objects.ends[scene, present].astype(float)
        away = point_segment_distance(centre, ends[:, 0], ends[:, 1]) - scenes.objects.radius[scene, present]
        hits.append(bool((away < NEAR_M).any()))
    return items[["scene", "kind"]].assign(detected=hits)


def recall(table: pd.DataFrame) -> pd.DataFrame:
    """Return the number of items and the share detected, by kind and over all."""
    by_kind = table.groupby("kind")["detected"].agg(["size", "mean"]).reset_index()
    whole = pd.DataFrame({"kind": ["all"], "size": [len(table)], "mean": [table["detected"].mean()]})
    return pd.concat([by_kind, whole], ignore_index=True).rename(columns={"size": "items", "mean": "recall"})


def unlisted(folder: Folder, scenes: Scenes) -> int:
    """Return how many detected objects cover no listed item, in the scenes that have listed items."""
    items = folder.items
    assert items is not None
    centres, count = folder.frame.to_model(items[["x", "y"]].to_numpy()), 0
    for name, rows in items.groupby("scene").indices.items():
        scene = scenes.names.index(str(name))
        present = scenes.objects.present[scene]
        ends = scenes.objects.ends[scene, present].astype(float)[:, None]
        away = point_segment_distance(centres[rows], ends[..., 0, :], ends[..., 1, :])  # (object, item)
        count += int((away - scenes.objects.radius[scene, present][:, None] >= NEAR_M).all(1).sum())
    return count
