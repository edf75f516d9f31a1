"""Scenes come back, and those that disagree with one another are refused."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.artifacts.scenes import SceneSet, read_scenes, write_scenes
from pipeline.runtime.errors import InputError
from pipeline.world.layout import random_layouts
from tests.factories import ITEMS, RULES, appearances

SCENES = 3
RNG = np.random.default_rng(0)
BARE = random_layouts(RNG, SCENES, ITEMS, np.arange(4), RULES)


def test_scenes_come_back_and_a_pool_without_images_or_with_others_is_refused(tmp_path: Path):
    pools = ["train-s0", "new_items"]
    layouts, looks = dict.fromkeys(pools, BARE), dict.fromkeys(pools, appearances(SCENES))
    images = {pool: RNG.integers(0, 256, (SCENES, 100, 100, 3), dtype=np.uint8) for pool in pools}
    write_scenes(tmp_path, SceneSet(images, layouts, looks))
    back = read_scenes(tmp_path)
    for pool in pools:
        np.testing.assert_array_equal(back.images[pool], images[pool])
        np.testing.assert_array_equal(back.layouts[pool].ends[BARE.present], BARE.ends[BARE.present])
    small = {pool: x[:, :50] for pool, x in images.items()}
    for other, message in (({"new_items": images["new_items"]}, "different pools"), (small, r"expected uint8 \(scene")):
        write_scenes(tmp_path, SceneSet(other, layouts, looks))
        with pytest.raises(InputError, match=message):
            read_scenes(tmp_path)
