"""Compare the detected objects with the items that a person listed."""

import numpy as np
import pandas as pd

from pipeline.own.data import Scenes
from pipeline.own.frame import Frame
from pipeline.world.layout import point_segment_distance

NEAR_M = 0.01  # an item's centre may lie this far outside a detected outline [m of the model]


def detected(items: pd.DataFrame, frame: Frame, scenes: Scenes) -> tuple[pd.DataFrame, int]:
    """Return one row for each listed item: scene, kind, and whether a detected object covers its centre.

    The number counts the detected objects that cover no listed item, in the scenes that have listed items.
    """
    centres, hits, unlisted = frame.to_model(items[["x", "y"]].to_numpy()), np.zeros(len(items), bool), 0
    for name, rows in items.groupby("scene").indices.items():
        scene = scenes.names.index(str(name))
        present = scenes.objects.present[scene]
        ends = scenes.objects.ends[scene, present].astype(float)[:, None]
        away = point_segment_distance(centres[rows], ends[..., 0, :], ends[..., 1, :])  # (object, item)
        near = away - scenes.objects.radius[scene, present][:, None] < NEAR_M
        hits[rows] = near.any(0)
        unlisted += int((~near.any(1)).sum())
    return items[["scene", "kind"]].assign(detected=hits), unlisted
