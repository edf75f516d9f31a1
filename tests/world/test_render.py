"""Images show each item where the layout says, in the light of the seed; an added item changes nothing away from it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.world.catalogue import Catalogue, read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, Layouts, empty
from pipeline.world.render import REACH_M, Palette, draw_light, render

CATALOGUE = read_catalogue(Path("data"))
LENS_M = 0.02  # the lens and a pixel that is touched in part spread a change by up to 2 px


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
    """Table coordinates [m] of the middle of `weight`; row 0 is the far edge."""
    rows, columns = np.indices(weight.shape)
    x, y = (columns + 0.5) / 100, 1 - (rows + 0.5) / 100
    return np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()


@pytest.mark.parametrize(("x", "y"), [(0.5, 0.5), (0.2, 0.8), (0.713, 0.234)])
def test_an_item_is_where_its_layout_says_and_as_large_and_row_0_is_the_far_edge(x, y):
    catalogue = disc_catalogue()
    layouts = with_item(empty(1, 4), 0, catalogue, 0, x, y)
    image = render(layouts, 0, "grey", 7, Palette(catalogue)).astype(float)
    redness = image[..., 0] - image[..., 1]
    np.testing.assert_allclose(centroid(np.clip(redness - 60, 0, None)), [x, y], atol=0.002)
    assert (redness > 100).sum() / SIDE**2 == pytest.approx(np.pi * 0.1**2, rel=0.04)


def test_every_item_stands_out_and_changes_the_image_only_as_far_as_its_shadow_reaches():
    palette = Palette(CATALOGUE)
    bare = render(empty(1, 4), 0, "walnut", 5, palette).astype(float)
    for item in range(len(CATALOGUE.items)):
        layouts = with_item(empty(1, 4), 0, CATALOGUE, item, 0.5, 0.5)
        change = np.abs(render(layouts, 0, "walnut", 5, palette) - bare).max(-1)
        assert change.max() > 30, CATALOGUE.items["name"][item]  # far above the sensor's noise
        rows, columns = np.nonzero(change)
        away = np.abs([(columns + 0.5) / SIDE - 0.5, 0.5 - (rows + 0.5) / SIDE]).max()
        assert away < layouts.radius[0, 0] + layouts.half_length[0, 0] + REACH_M + LENS_M


@pytest.mark.parametrize("seed", range(4))
def test_the_table_is_brighter_towards_the_lamp_and_shadows_fall_away_from_it(seed: int):
    white, lamp = disc_catalogue((255, 255, 255, 255)), draw_light(seed).direction
    rows, columns = np.indices((SIDE, SIDE))
    lit = np.stack([(columns + 0.5) / SIDE - 0.5, 0.5 - (rows + 0.5) / SIDE], -1) @ lamp > 0
    bare = render(empty(1, 4), 0, "grey", seed, Palette(white)).astype(float).mean(-1)
    assert bare[lit].mean() > bare[~lit].mean()
    seen = render(with_item(empty(1, 4), 0, white, 0, 0.5, 0.5), 0, "grey", seed, Palette(white)).mean(-1)
    assert (centroid(np.clip(bare - seen, 0, None)) - 0.5) @ lamp < -0.03
