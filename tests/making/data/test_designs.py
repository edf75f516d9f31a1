"""data/ is what the script draws."""

from pathlib import Path

import numpy as np
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
