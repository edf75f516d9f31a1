"""Scenes come back as they were written; files that disagree are refused."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool, write_scenes
from pipeline.runtime.errors import InputError
from pipeline.world.layout import empty


def some_scenes() -> SceneSet:
    rng = np.random.default_rng(0)
    images, layouts, appearances = {}, {}, {}
    for pool in (train_pool(0), "new_items"):
        batch = empty(3, 4)
        for scene, slot in ((0, 0), (0, 1), (1, 0), (2, 0), (2, 1), (2, 2)):
            batch.symbol[scene, slot], batch.item[scene, slot] = rng.integers(4), rng.integers(24)
            batch.centre[scene, slot] = rng.uniform(size=2)
            for name in ("angle", "scale", "half_length", "radius"):
                getattr(batch, name)[scene, slot] = rng.uniform()
        images[pool] = rng.integers(0, 256, (3, 100, 100, 3), dtype=np.uint8)
        layouts[pool] = batch
        appearances[pool] = pd.DataFrame({"texture": ["oak"] * 3, "render_seed": [1, 2, 3]})
    return SceneSet(images, layouts, appearances)


def test_a_pool_without_images_and_images_of_another_size_are_refused(tmp_path: Path):
    scenes = some_scenes()
    one_pool = {"new_items": scenes.images["new_items"]}
    small = {pool: images[:, :50] for pool, images in scenes.images.items()}
    for images, message in ((one_pool, "different pools"), (small, r"expected uint8 \(scene, 100, 100, 3\)")):
        write_scenes(tmp_path, SceneSet(images, scenes.layouts, scenes.appearances))
        with pytest.raises(InputError, match=message):
            read_scenes(tmp_path)
