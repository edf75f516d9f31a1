"""Objects are compared with the truth item by item, and accuracies are averaged as they say."""

import numpy as np
import pandas as pd
import pytest

from making.segmenter.pool import between
from pipeline.perception.objects import Objects
from pipeline.world.layout import SIDE
from studies.perception.stage import found_items, mean_accuracy


def picture(*discs: tuple[float, float, float]) -> np.ndarray:
    """Instances of discs (x, y, radius) [m]."""
    y, x = np.mgrid[:SIDE, :SIDE] + 0.5
    instances = np.zeros((SIDE, SIDE), np.uint8)
    for i, (at_x, at_y, radius) in enumerate(discs, 1):
        instances[np.hypot(x - SIDE * at_x, SIDE * (1 - at_y) - y) < SIDE * radius] = i
    return instances


def objects(*discs: tuple[float, float, float]) -> Objects:
    """Detected discs (x, y, radius) [m]."""
    found = Objects.of([[]], [0.0], 0)
    for i, (x, y, radius) in enumerate(discs):
        found.ends[0, i], found.radius[0, i], found.present[0, i] = (x, y), radius, True
    return found


PLATE, GLASS = (0.3, 0.4, 0.08), (0.7, 0.6, 0.04)


def test_true_discs_match_in_any_order_a_missed_item_has_no_overlap_and_an_object_elsewhere_is_made_up():
    found = found_items(objects(GLASS, PLATE), picture(PLATE, GLASS)[None])
    assert found["item"].tolist() == [1, 2] and found["iou"].tolist() == pytest.approx([1, 1], abs=0.1)
    found = found_items(objects(PLATE, (0.1, 0.9, 0.05)), picture(PLATE, GLASS)[None])
    assert found["item"].tolist() == [1, 2, -1] and found["iou"].tolist() == pytest.approx([1, 0, 0], abs=0.1)
    assert found_items(objects(PLATE), picture()[None])["item"].tolist() == [-1]


def test_only_pixels_near_two_items_are_between_them():
    assert between(picture(PLATE, GLASS)).sum() == 0
    close = between(picture(PLATE, (PLATE[0] + 0.08 + 0.04 + 0.01, 0.4, 0.04)))
    assert 5 < close.sum() < 60


def test_means_are_over_scenes_and_users_and_quartiles_over_seeds():
    scene = {"source": "split", "detector": "segmenter"}
    rows = pd.DataFrame(
        [
            scene | {"user": user, "seed": seed, "scene": i, "top": top, "accuracy": accuracy}
            for seed, shift in enumerate((0.0, 0.1, 0.2))
            for i, top in enumerate(("wood", "wood", "cloth"))
            for user, accuracy in (("careful", 0.3 * i + shift), ("normal", 0.1 + shift))
        ]
    )
    table = mean_accuracy(rows).set_index(["top", "user"])
    assert table.loc[("all", "careful"), "accuracy"] == pytest.approx(0.4)
    assert table.loc[("wood", "careful"), ["scenes", "seeds", "accuracy"]].tolist() == pytest.approx([2, 3, 0.25])
    assert table.loc[("all", "all"), ["q1", "accuracy", "q3"]].tolist() == pytest.approx([0.25, 0.3, 0.35])
