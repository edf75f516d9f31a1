"""The rendered pictures in data/ obey the layout rules, and held-out kinds are shown nowhere else."""

from pathlib import Path

import pandas as pd
import pytest

from making.render.read import Rendered, read_rendered
from pipeline.runtime.errors import InputError
from pipeline.world.layout import LayoutRules
from tests.factories import assert_clear, composed

FOLDER = Path("rendered/pictures")
JUDGED = ("validation_taught", "validation_held_out", "test_taught", "test_held_out")  # splits with added items
ROUNDING_M = 3e-5  # lengths in items.csv have five decimals


@pytest.fixture(scope="module")
def folder() -> Path:
    if not FOLDER.is_dir():
        pytest.skip(f"{FOLDER} is absent: make data-here")
    return FOLDER


@pytest.fixture(scope="module", params=["train", *JUDGED])
def rendered(folder: Path, request: pytest.FixtureRequest) -> Rendered:
    return read_rendered(folder / request.param)


def test_items_keep_the_distances_of_the_layout_rules(rendered):
    rules = LayoutRules.of(composed().scenes.layout)
    for layouts in (rendered.layouts, *rendered.layouts_with_item.values()):
        centre = layouts.centre[layouts.present]
        assert centre.min() >= rules.centre_low - ROUNDING_M and centre.max() <= rules.centre_high + ROUNDING_M
        assert_clear(layouts, rules, ROUNDING_M, ROUNDING_M)
    assert set(rendered.layouts.present.sum(1)) == set(rules.items_per_scene)


@pytest.mark.parametrize(
    ("split", "others"), [("validation_held_out", ["train"]), ("test_held_out", ["train", *JUDGED[:3]])]
)
def test_no_other_split_shows_the_kinds_that_one_of_kinds_held_out_holds(folder, split, others):
    """So that no training picture shows those held out, and no earlier picture those of the sealed test."""
    for name, column in (("items.csv", "shape"), ("items.csv", "finish"), ("scenes.csv", "top")):
        held_out, *shown = (set(pd.read_csv(folder / s / name)[column]) for s in (split, *others))
        assert not held_out & set().union(*shown), column


def test_a_missing_split_is_a_sentence(tmp_path):
    with pytest.raises(InputError, match=r"scenes\.csv is missing: run `dvc pull"):
        read_rendered(tmp_path)
