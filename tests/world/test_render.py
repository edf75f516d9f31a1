"""Images show each item where the layout says, and an added item changes nothing away from it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, Layouts, empty
from pipeline.world.render import Palette, render, render_scenes
from pipeline.world.source import draw_light

DATA = Path("data")


def disc_catalogue(colour: tuple[int, int, int, int] = (255, 0, 0, 255)) -> Catalogue:
    """A coloured disc 0.2 m wide, a bar 0.3 m long with a blue right end, on a plain grey table."""
    axis = (np.arange(256) + 0.5) / 256 * 2 - 1
    x, y = np.meshgrid(axis, axis)
    disc = np.where((np.hypot(x, y) < 1)[..., None], np.array(colour), 0).astype(np.uint8)
    bar = np.where((np.abs(y) < 0.2)[..., None], np.array([0, 255, 0, 255]), 0).astype(np.uint8)
    bar[(np.abs(y) < 0.2) & (x > 0)] = (0, 0, 255, 255)
    columns = ["name", "symbol", "split", "width_m", "radius_m", "half_length_m"]
    rows = [("disc", "plate", "train", 0.2, 0.1, 0.0), ("bar", "cutlery", "train", 0.3, 0.03, 0.12)]
    items = pd.DataFrame(rows, columns=columns)
    textures = pd.DataFrame({"name": ["grey"], "split": ["train"], "width_m": [1.0]})
    return Catalogue(items, [disc, bar], textures, [np.full((160, 160, 3), 128, np.uint8)])


def with_item(layouts: Layouts, slot: int, catalogue: Catalogue, item: int, x: float, y: float, angle: float = 0.0):
    """The one scene of `layouts` with a catalogue item in `slot`, at scale 1."""
    row = catalogue.items.iloc[item]
    layouts.item[0, slot], layouts.symbol[0, slot] = item, SYMBOLS.index(row["symbol"])
    layouts.centre[0, slot], layouts.angle[0, slot], layouts.scale[0, slot] = (x, y), angle, 1.0
    layouts.radius[0, slot], layouts.half_length[0, slot] = row["radius_m"], row["half_length_m"]
    return layouts


def centroid(weight: np.ndarray) -> np.ndarray:
    """Table coordinates [m] of the middle of `weight`, by the convention of design: row 0 at the far edge."""
    rows, columns = np.indices(weight.shape)
    x, y = (columns + 0.5) / 100, 1 - (rows + 0.5) / 100
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


@pytest.mark.parametrize(("x", "y"), [(0.5, 0.5), (0.2, 0.8), (0.713, 0.234), (0.85, 0.15)])
def test_an_item_is_where_its_layout_says_and_as_large_and_row_0_is_the_far_edge(x, y):
    catalogue = disc_catalogue()
    layouts = with_item(empty(1, 4), 0, catalogue, 0, x, y)
    image = render(layouts, 0, "grey", 7, Palette(catalogue)).astype(float)
    redness = image[..., 0] - image[..., 1]
    np.testing.assert_allclose(centroid(np.clip(redness - 60, 0, None)), [x, y], atol=0.002)
    assert (redness > 100).sum() / SIDE**2 == pytest.approx(np.pi * 0.1**2, rel=0.04)
    if y == 0.8:
        assert (redness[:50] > 60).any() and not (redness[50:] > 60).any()


@pytest.mark.parametrize("angle", [0.0, 0.6, np.pi / 2, -2.0])
def test_an_angle_turns_an_item_from_the_x_axis_towards_y(angle):
    catalogue = disc_catalogue()
    layouts = with_item(empty(1, 4), 0, catalogue, 1, 0.5, 0.5, angle)
    image = render(layouts, 0, "grey", 7, Palette(catalogue)).astype(float)
    blue = np.clip(image[..., 2] - np.maximum(image[..., 0], image[..., 1]) - 60, 0, None)
    green = np.clip(image[..., 1] - np.maximum(image[..., 0], image[..., 2]) - 60, 0, None)
    along = centroid(blue) - centroid(green)
    bearing = np.arctan2(along[1], along[0])
    assert np.cos(bearing - angle) > 0.999


def test_the_same_seed_gives_the_same_image_whatever_its_batch_and_another_seed_another():
    catalogue = read_catalogue(DATA)
    palette = Palette(catalogue)
    layouts = with_item(empty(2, 4), 0, catalogue, 0, 0.5, 0.5)
    one, again, other = (render(layouts, 0, "linen", seed, palette) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert (one != other).mean() > 0.5
    batch = render_scenes(layouts, ["oak", "walnut"], [3, 4], palette)
    np.testing.assert_array_equal(batch[1], render(layouts, 1, "walnut", 4, palette))


def test_every_item_stands_out_from_some_table_top_it_is_laid_on():
    """Each item of the catalogue changes the image by more than the sensor's noise does."""
    catalogue = read_catalogue(DATA)
    palette = Palette(catalogue)
    for item in range(len(catalogue.items)):
        layouts = with_item(empty(1, 4), 0, catalogue, item, 0.5, 0.5)
        bare = render(empty(1, 4), 0, "walnut", 5, palette).astype(float)
        seen = render(layouts, 0, "walnut", 5, palette).astype(float)
        assert np.abs(seen - bare).max() > 30, catalogue.items["name"][item]


def test_an_unknown_texture_and_an_item_beyond_the_catalogue_are_refused():
    catalogue = disc_catalogue()
    layouts = with_item(empty(1, 4), 0, catalogue, 0, 0.5, 0.5)
    layouts.item[0, 0] = 9
    for texture, message in (("grass", "unknown texture 'grass'"), ("grey", "item 9 is not in the catalogue")):
        with pytest.raises(ValueError, match=message):
            render(layouts, 0, texture, 0, Palette(catalogue))


@pytest.mark.parametrize("seed", range(8))
def test_the_table_is_brighter_towards_the_lamp_and_shadows_fall_away_from_it(seed: int):
    white = disc_catalogue((255, 255, 255, 255))
    bare = render(empty(1, 4), 0, "grey", seed, Palette(white)).astype(float).mean(-1)
    lit = towards_lamp(seed) > 0
    assert bare[lit].mean() > bare[~lit].mean()
    seen = render(with_item(empty(1, 4), 0, white, 0, 0.5, 0.5), 0, "grey", seed, Palette(white)).mean(-1)
    assert (centroid(np.clip(bare - seen, 0, None)) - 0.5) @ draw_light(seed).direction < -0.03


def from_middle() -> np.ndarray:
    """Each pixel's offset [m] from the middle of the table."""
    rows, columns = np.indices((SIDE, SIDE))
    return np.stack([(columns + 0.5) / SIDE - 0.5, 0.5 - (rows + 0.5) / SIDE], -1)


def towards_lamp(seed: int) -> np.ndarray:
    """How far [m] each pixel of the table lies from its middle towards the lamp."""
    return from_middle() @ draw_light(seed).direction
