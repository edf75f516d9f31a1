"""data/ is what the script draws."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from making.data.designs import designs, surfaces
from pipeline.world.images import read_image

pytestmark = pytest.mark.slow

DATA = Path("data")
SAMPLE = {(design.symbol, design.split): design for design in designs()}  # all would take longer than 10 s


@pytest.mark.parametrize(
    ("file", "draw"),
    [(f"items/{design.name}.png", design.draw) for design in SAMPLE.values()]
    + [(f"textures/{name}.png", draw) for name, (_, draw) in surfaces().items()],
)
def test_data_holds_what_the_script_draws(file, draw):
    """To one grey level: libm may round otherwise on another machine."""
    stored = read_image(DATA / file).astype(int)
    assert np.abs(stored - draw()).max() <= 1


def test_data_holds_no_other_file_and_lists_the_designs_in_their_order():
    images = {f"items/{design.name}.png" for design in designs()} | {f"textures/{name}.png" for name in surfaces()}
    files = {str(path.relative_to(DATA)) for path in DATA.rglob("*") if path.is_file()}
    assert files == {"items.csv", "textures.csv", *images}
    table = pd.read_csv(DATA / "items.csv")
    assert [*zip(table["name"], table["split"], strict=True)] == [(design.name, design.split) for design in designs()]
    np.testing.assert_allclose(table["width_m"], [design.width_m for design in designs()], atol=5e-5)
