"""Scenes, demonstrations and added items that disagree with one another are refused."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import SceneSet, layout_table, read_interventions, read_scenes, write_scenes
from pipeline.runtime.errors import InputError
from pipeline.world.layout import SYMBOLS, add_item, random_layouts
from tests.factories import ITEMS, RULES, appearances

SCENES = 3
RNG = np.random.default_rng(0)
BARE = random_layouts(RNG, SCENES, ITEMS, np.arange(4), RULES)
ADDED = [add_item(RNG, BARE, symbol, ITEMS, np.arange(4), RULES) for symbol in range(4)]


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """What stage intervene writes."""
    tables = [layout_table(f"{symbol}-0", x) for symbol, x in zip(SYMBOLS, ADDED, strict=True)]
    write_table(tmp_path / "layouts.parquet", pd.concat(tables, ignore_index=True))
    images = np.arange(4 * SCENES, dtype=np.uint8).reshape(4, 1, SCENES, 1, 1, 1) * np.ones((100, 100, 3), np.uint8)
    write_arrays(tmp_path / "images.npz", {"images": images})
    return tmp_path


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


def test_layouts_and_images_come_back_and_what_was_added_stands_by_itself(written: Path):
    added = read_interventions(written, BARE)
    assert added.images[2, 1, 0, 0, 0] == 2 * SCENES + 1
    for symbol, (read, alone, wrote) in enumerate(zip(added.layouts, added.placed, ADDED, strict=True)):
        for name in ("symbol", "ends", "radius"):
            np.testing.assert_array_equal(getattr(read, name), getattr(wrote, name))
        assert alone.present.all() and (alone.symbol == symbol).all()
        at = np.arange(SCENES), wrote.present.sum(1) - 1
        np.testing.assert_array_equal(added.item[symbol], wrote.item[at])
        np.testing.assert_array_equal(alone.centre[:, 0], wrote.centre[at])
