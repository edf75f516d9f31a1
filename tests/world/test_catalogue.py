"""The catalogue is complete, glasses are translucent, and one message names what is wrong in data/."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from pipeline.runtime.errors import InputError
from pipeline.world.catalogue import read_catalogue

DATA = Path("data")


@pytest.fixture(scope="module")
def catalogue():
    return read_catalogue(DATA)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A copy of data/ that a test may spoil."""
    shutil.copytree(DATA, tmp_path / "data")
    return tmp_path / "data"


def spoil(data: Path, column: str, value: object, row: int = 0) -> None:
    table = pd.read_csv(data / "items.csv").astype({column: object})
    table.loc[row, column] = value
    table.to_csv(data / "items.csv", index=False)


def test_the_table_shows_through_glasses_alone(catalogue):
    for row, cutout in zip(catalogue.items.itertuples(), catalogue.cutouts, strict=True):
        alpha = cutout[..., 3] / 255
        if row.symbol == "glass":
            axis = ((np.arange(len(cutout)) + 0.5) / len(cutout) - 0.5) * row.width_m
            x, y = np.meshgrid(axis, axis)
            off_the_capsule = np.hypot(np.maximum(np.abs(x) - row.half_length_m, 0), y) - row.radius_m
            inside = off_the_capsule < -0.15 * row.radius_m
            assert np.median(alpha[inside]) < 0.4, row.name
            assert alpha.max() > 0.5, f"{row.name} has no rim or highlight"
        else:
            cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
            solid = np.pad((alpha > 0).astype(np.uint8), 1)
            inside = cv2.erode(solid, cross, iterations=4)[1:-1, 1:-1]
            assert alpha[inside > 0].min() == 1.0, row.name


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("symbol", "saucepan", "saucepan"),
        ("width_m", -0.12, "-0.12"),
        ("radius_m", 0.2, "footprint"),
        ("half_length_m", 0.01, "disc"),
        ("name", "plate-white", "plate-white"),
        ("licence", None, "licence"),
    ],
)
def test_a_wrong_value_is_named_with_its_file(data, column, value, message):
    spoil(data, column, value)
    with pytest.raises(InputError, match=r"items\.csv") as error:
        read_catalogue(data)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("scaled", "factor", "direction"), [("width_m", 1.2, "long"), ("radius_m", 0.7, "long"), ("radius_m", 0.7, "broad")]
)
def test_a_cutout_that_does_not_fill_its_footprint_is_refused(data, scaled, factor, direction):
    """Row 0 is a disc, and `broad` tests a capsule of its length."""
    table = pd.read_csv(data / "items.csv")
    if direction == "broad":
        table.loc[0, "shape"], table.loc[0, "half_length_m"] = "capsule", table.loc[0, "radius_m"] * (1 - factor)
    table.loc[0, scaled] *= factor
    table.to_csv(data / "items.csv", index=False)
    with pytest.raises(InputError, match=f"bowl-white.png shows an item .* {direction}, .* footprint"):
        read_catalogue(data)
