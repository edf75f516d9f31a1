"""The catalogue is complete, glasses are translucent, and one message names what is wrong in data/."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from pipeline.world.catalogue import MIN_ITEMS, MIN_SIDE_PX, CatalogueError, read_catalogue
from pipeline.world.images import read_image, write_png

DATA = Path("data")
VISIBLE = 20  # least alpha of what belongs to an item; a thin glass has 27


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


def test_pools_are_a_partition_and_cutouts_are_large_unlike_and_cropped_tightly(catalogue):
    """So that width_m is the item's own length, within 5 % (facets lie inside the circle of their corners)."""
    rows = np.concatenate([catalogue.pool(split) for split in MIN_ITEMS])
    assert sorted(rows) == list(range(len(catalogue.items)))
    assert len({c.tobytes() for c in catalogue.cutouts}) == len(catalogue.cutouts)
    for name, cutout in zip(catalogue.items["name"], catalogue.cutouts, strict=True):
        rows, columns = np.nonzero(cutout[..., 3] > 25)
        assert len(cutout) >= MIN_SIDE_PX and max(np.ptp(rows), np.ptp(columns)) + 1 > 0.95 * len(cutout), name


def off_the_footprint(row, cutout: np.ndarray) -> np.ndarray:
    """Signed distance [m] of each pixel of a cutout from the capsule that the rules know, negative inside."""
    axis = ((np.arange(len(cutout)) + 0.5) / len(cutout) - 0.5) * row.width_m
    x, y = np.meshgrid(axis, axis)
    return np.hypot(np.maximum(np.abs(x) - row.half_length_m, 0), y) - row.radius_m


def test_outlines_keep_to_their_footprint_and_fill_it(catalogue):
    """Within 2 mm, and new ones within a pixel of the capsule that the rules know.

    Crockery and glasses fill it by area; cutlery, slender between its ends, by the width of its widest part.
    """
    for row, cutout in zip(catalogue.items.itertuples(), catalogue.cutouts, strict=True):
        alpha, off = cutout[..., 3], off_the_footprint(row, cutout)
        assert off[alpha > 128].max() < 0.002, row.name
        assert row.split == "train" or off[alpha > 0].max() < row.width_m / len(cutout), row.name
        if row.symbol == "cutlery":
            breadth = np.ptp(np.nonzero(alpha > VISIBLE)[0]) + 1
            assert breadth * row.width_m / len(cutout) > 0.78 * 2 * row.radius_m, row.name
        else:
            assert ((alpha > VISIBLE) & (off < 0)).sum() > 0.85 * (off < 0).sum(), row.name


def test_the_table_shows_through_glasses_alone(catalogue):
    for row, cutout in zip(catalogue.items.itertuples(), catalogue.cutouts, strict=True):
        alpha = cutout[..., 3] / 255
        if row.symbol == "glass":
            inside = off_the_footprint(row, cutout) < -0.15 * row.radius_m
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
        ("split", "test", "test"),
        ("width_m", -0.12, "-0.12"),
        ("radius_m", -0.06, "-0.06"),
        ("radius_m", 0.2, "footprint"),
        ("half_length_m", 0.01, "disc"),
        ("name", "plate-white", "plate-white"),
        ("width_m", "wide", "width_m"),
        ("licence", None, "licence"),
    ],
)
def test_a_wrong_value_is_named_with_its_file(data, column, value, message):
    spoil(data, column, value)
    with pytest.raises(CatalogueError, match=r"items\.csv") as error:
        read_catalogue(data)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_wrong_value_is_named_with_its_line_and_a_missing_column_by_name(data):
    table = pd.read_csv(data / "items.csv")
    table.drop(columns="source").to_csv(data / "items.csv", index=False)
    with pytest.raises(CatalogueError, match="source"):
        read_catalogue(data)
    table.to_csv(data / "items.csv", index=False)
    spoil(data, "width_m", -0.1, row=3)
    with pytest.raises(CatalogueError, match="line 5, width_m"):
        read_catalogue(data)


@pytest.mark.parametrize(
    ("scaled", "factor", "direction"),
    [("width_m", 7.0, "long"), ("width_m", 1.2, "long"), ("radius_m", 0.7, "long"), ("radius_m", 0.7, "broad")],
)
def test_a_cutout_that_does_not_fill_its_footprint_is_refused(data, scaled, factor, direction):
    """Row 0 is a disc, and `broad` tests a capsule of its length."""
    table = pd.read_csv(data / "items.csv")
    if direction == "broad":
        table.loc[0, "shape"], table.loc[0, "half_length_m"] = "capsule", table.loc[0, "radius_m"] * (1 - factor)
    table.loc[0, scaled] *= factor
    table.to_csv(data / "items.csv", index=False)
    with pytest.raises(CatalogueError, match=f"bowl-white.png shows an item .* {direction}, .* footprint"):
        read_catalogue(data)


@pytest.mark.parametrize(("split", "kept"), [("train", 0), ("unseen", 0), ("unseen", 1), ("validation", 1)])
def test_a_symbol_with_too_few_items_in_a_split_is_refused(data, split, kept):
    """What is judged has two at least: intervals count items."""
    table = pd.read_csv(data / "items.csv")
    glasses = table.index[(table["symbol"] == "glass") & (table["split"] == split)]
    table.drop(index=glasses[kept:]).to_csv(data / "items.csv", index=False)
    message = rf"too few {split} items \({kept} of glass\): expected at least {MIN_ITEMS[split]} of each symbol"
    with pytest.raises(CatalogueError, match=message):
        read_catalogue(data)


@pytest.mark.parametrize("content", [b"", b"\xff\xfe\x00junk", b'a,b\n"1,2\n3,4,5\n'])
def test_a_catalogue_that_is_no_csv_is_refused(data, content):
    (data / "items.csv").write_bytes(content)
    with pytest.raises(CatalogueError, match=r"items\.csv"):
        read_catalogue(data)


def test_missing_data_says_where_to_get_it_and_a_truncated_table_top_is_named(data, tmp_path):
    with pytest.raises(CatalogueError, match="dvc pull"):
        read_catalogue(tmp_path)
    truncate(data / "textures" / "oak.png")
    with pytest.raises(CatalogueError, match=r"oak\.png"):
        read_catalogue(data)


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def opaque(path: Path) -> None:
    rgba = read_image(path)
    rgba[..., 3] = 255
    write_png(path, rgba)


def enlarge(path: Path) -> None:
    """Write the header of a PNG that would take 900 MB to decode."""
    size = (15000).to_bytes(4, "big") * 2
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + (13).to_bytes(4, "big") + b"IHDR" + size + b"\x08\x06" + bytes(7))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (Path.unlink, "missing"),
        (truncate, "truncated"),
        (lambda path: path.write_text("not an image"), "not a PNG"),
        (lambda path: write_png(path, cv2.resize(read_image(path), (128, 128))), "128 x 128"),
        (lambda path: write_png(path, cv2.resize(read_image(path), (300, 256))), "300 x 256"),
        (lambda path: write_png(path, read_image(path)[..., :3]), "alpha"),
        (opaque, "alpha"),
        (enlarge, "15000 x 15000 pixels: expected at most 4096 a side"),
    ],
)
def test_a_spoilt_cutout_is_named(data, damage, message):
    path = data / "items" / "bowl-sage.png"
    damage(path)
    with pytest.raises(CatalogueError, match=r"bowl-sage\.png") as error:
        read_catalogue(data)
    assert message in str(error.value)
