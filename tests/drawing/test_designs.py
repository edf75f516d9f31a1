"""Drawing is repeatable, and data/ is what the script draws."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from PIL import Image

from drawing.__main__ import contact_sheet
from drawing.crockery import bowl
from drawing.designs import designs, surfaces
from drawing.surface import surface
from pipeline.table.layout import SYMBOLS

DATA = Path("data")
ONE_OF_EACH = {design.symbol: design for design in designs()}


@pytest.mark.parametrize("symbol", SYMBOLS)
def test_an_item_drawn_twice_is_the_same_to_the_last_bit(symbol):
    np.testing.assert_array_equal(ONE_OF_EACH[symbol].draw(), ONE_OF_EACH[symbol].draw())


@pytest.mark.parametrize("symbol", SYMBOLS)
def test_data_holds_what_the_script_draws(symbol):
    """To one grey level: libm may round otherwise on another machine."""
    design = ONE_OF_EACH[symbol]
    stored = np.asarray(Image.open(DATA / "items" / f"{design.name}.png")).astype(int)
    assert np.abs(stored - design.draw()).max() <= 1


def test_the_catalogue_lists_the_designs_in_their_order():
    table = pd.read_csv(DATA / "items.csv")
    assert table["name"].tolist() == [design.name for design in designs()]
    assert table["split"].tolist() == [design.split for design in designs()]
    np.testing.assert_allclose(table["width_m"], [design.width_m for design in designs()], atol=5e-5)
    assert pd.read_csv(DATA / "textures.csv")["name"].tolist() == list(surfaces())


def test_a_bowl_is_deeper_in_the_middle_than_at_its_rim():
    """Depth, seen as shade, tells a white bowl from a white plate."""
    rgba = bowl(0, (0.9, 0.9, 0.9), (0.9, 0.9, 0.9), (0.2, 0.2, 0.2), "plain", 0.55).astype(float)
    axis = (np.arange(len(rgba)) + 0.5) / len(rgba) * 2 - 1
    r = np.hypot(*np.meshgrid(axis, axis))
    assert rgba[r < 0.3][:, :3].mean() < 0.85 * rgba[(r > 0.85) & (r < 0.95)][:, :3].mean()


def test_the_contact_sheet_shows_every_item():
    sheet = contact_sheet(DATA)
    columns = 15
    cell = sheet.width // columns
    assert sheet.height == cell * -(-len(designs()) // columns)


def test_an_unknown_pattern_or_table_top_is_refused():
    grey = (0.5, 0.5, 0.5)
    with pytest.raises(ValueError, match="unknown pattern 'stars'"):
        bowl(0, grey, grey, grey, "stars", 0.5)
    with pytest.raises(ValueError, match="unknown table top 'grass'"):
        surface(0, "grass", grey, grey)
