"""The rendered pictures in data/ obey the layout rules, and held-out kinds are shown nowhere else."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from making.render.read import Rendered, pictures, read_rendered, sheet
from pipeline.runtime.errors import InputError
from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.layout import SIDE, SYMBOLS, LayoutRules, point_segment_distance, segment_distance

FOLDER = Path("rendered/pictures")
JUDGED = ("validation_taught", "validation_held_out", "test_taught", "test_held_out")  # splits with added items
ROUNDING_M = 3e-5  # lengths in items.csv have five decimals


@pytest.fixture(scope="module")
def folder() -> Path:
    if not FOLDER.is_dir():
        pytest.skip(f"{FOLDER} is absent: dvc pull rendered/pictures.dvc")
    return FOLDER


@pytest.fixture(scope="module", params=["train", *JUDGED])
def rendered(folder: Path, request: pytest.FixtureRequest) -> Rendered:
    return read_rendered(folder / request.param)


@pytest.fixture(scope="module", params=JUDGED)
def judged(folder: Path, request: pytest.FixtureRequest) -> Rendered:
    return read_rendered(folder / request.param)


@pytest.fixture(scope="module")
def rules() -> LayoutRules:
    return LayoutRules.of(yaml.safe_load(Path("conf/scenes.yaml").read_text())["scenes"]["layout"])


def distance_to_footprint(layouts, scene: int, slot: int) -> np.ndarray:
    """Distance [m] of each pixel's centre from a footprint, negative inside."""
    centres = (np.arange(SIDE) + 0.5) / SIDE
    points = np.stack(np.meshgrid(centres, 1 - centres), -1)
    return point_segment_distance(points, *layouts.ends[scene, slot]) - layouts.radius[scene, slot]


def test_items_keep_the_distances_of_the_layout_rules(rendered, rules):
    for layouts in (rendered.layouts, *rendered.layouts_with_item.values()):
        ends, radius, present = layouts.ends, layouts.radius, layouts.present
        centre = layouts.centre[present]
        assert centre.min() >= rules.centre_low - ROUNDING_M and centre.max() <= rules.centre_high + ROUNDING_M
        for p in (P_INIT, P_F):
            gap = point_segment_distance(p, ends[:, :, 0], ends[:, :, 1]) - radius
            assert gap[present].min() >= rules.clear_of_ends - ROUNDING_M
        for i in range(1, rules.slots):
            for j in range(i):
                gap = segment_distance(ends[:, i], ends[:, j]) - radius[:, i] - radius[:, j]
                assert gap[present[:, i] & present[:, j]].min(initial=1) >= rules.clear_of_items - ROUNDING_M
    assert set(rendered.layouts.present.sum(1)) == set(rules.items_per_scene)


def test_an_added_item_changes_the_picture_inside_its_footprint_and_not_far_away(judged):
    assert tuple(judged.with_item) == SYMBOLS
    for symbol, images in judged.with_item.items():
        layouts = judged.layouts_with_item[symbol]
        changed = (
            np.abs(images.astype(int) - judged.images).max(-1) > 6
        )  # camera noise seldom changes a channel by more, of 255
        added = layouts.present & ~judged.layouts.present
        assert (added.sum(1) == 1).all() and (layouts.symbol[added] == SYMBOLS.index(symbol)).all()
        inside, far = [], []
        for scene, slot in np.argwhere(added):
            distance = distance_to_footprint(layouts, scene, slot)
            inside.append(changed[scene][distance < -0.002].mean())
            far.append(changed[scene][distance > 0.4].mean())
        assert np.median(inside) > 0.9
        assert np.mean(far) < 0.01


@pytest.mark.parametrize(
    ("split", "others"), [("validation_held_out", ["train"]), ("test_held_out", ["train", *JUDGED[:3]])]
)
def test_no_other_split_shows_the_kinds_that_one_of_kinds_held_out_holds(folder, split, others):
    """So that no training picture shows those held out, and no earlier picture those of the sealed test."""
    for name, column in (("items.csv", "shape"), ("items.csv", "finish"), ("scenes.csv", "top")):
        held_out, *shown = (set(pd.read_csv(folder / s / name)[column]) for s in (split, *others))
        assert not held_out & set().union(*shown), column


def test_a_contact_sheet_holds_the_pictures_in_order():
    images = np.random.default_rng(0).integers(0, 256, (13, SIDE, SIDE, 3), dtype=np.uint8)
    np.testing.assert_array_equal(pictures(sheet(images))[:13], images)


def test_a_missing_split_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match=r"scenes\.csv is missing: run `dvc pull"):
        read_rendered(tmp_path)
