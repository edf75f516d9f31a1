"""Tables with an added item come back as stage intervene wrote them, or not at all."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.artifacts.files import write_arrays, write_table
from pipeline.artifacts.scenes import layout_table, read_interventions
from pipeline.runtime.errors import InputError
from pipeline.world.layout import SYMBOLS, Layouts, add_item, empty, random_layouts
from tests.factories import ITEMS, RULES

SCENES = 3


@pytest.fixture
def written(tmp_path: Path) -> tuple[Path, Layouts, list[Layouts]]:
    rng = np.random.default_rng(0)
    bare = random_layouts(rng, SCENES, ITEMS, np.arange(4), RULES)
    added = [add_item(rng, bare, symbol, ITEMS, np.arange(4), RULES) for symbol in range(4)]
    tables = [layout_table(f"{symbol}-0", x) for symbol, x in zip(SYMBOLS, added, strict=True)]
    write_table(tmp_path / "layouts.parquet", pd.concat(tables, ignore_index=True))
    images = np.arange(4 * SCENES, dtype=np.uint8).reshape(4, 1, SCENES, 1, 1, 1) * np.ones((100, 100, 3), np.uint8)
    write_arrays(tmp_path / "images.npz", {"images": images})
    return tmp_path, bare, added


def test_layouts_and_images_come_back_and_what_was_added_stands_by_itself(written: tuple[Path, Layouts, list[Layouts]]):
    folder, bare, layouts = written
    added = read_interventions(folder, bare)
    assert added.images[2, 1, 0, 0, 0] == 2 * SCENES + 1
    for symbol, (read, alone, wrote) in enumerate(zip(added.layouts, added.placed, layouts, strict=True)):
        for name in ("symbol", "ends", "radius"):
            np.testing.assert_array_equal(getattr(read, name), getattr(wrote, name))
        assert alone.present.all() and (alone.symbol == symbol).all()
        at = np.arange(SCENES), wrote.present.sum(1) - 1
        np.testing.assert_array_equal(added.item[symbol], wrote.item[at])
        np.testing.assert_array_equal(alone.centre[:, 0], wrote.centre[at])


def test_too_few_slots_and_other_scenes_are_refused(written: tuple[Path, Layouts, list[Layouts]]):
    folder, bare, _ = written
    elsewhere = random_layouts(np.random.default_rng(1), SCENES, ITEMS, np.arange(4), RULES)
    other = "not these scenes with an added bowl in each"
    for scenes, message in ((elsewhere, other), (bare[:2], other), (empty(SCENES, 2), "run the intervene stage again")):
        with pytest.raises(InputError, match=message):
            read_interventions(folder, scenes)
    write_arrays(folder / "images.npz", {"images": np.zeros((4, 1, SCENES + 1, 100, 100, 3), np.uint8)})
    with pytest.raises(InputError, match="4 images of scenes with an added bowl, layouts of 3"):
        read_interventions(folder, bare)
