"""Drawing is repeatable, and data/ is what the script draws."""

from pathlib import Path

import numpy as np
import pytest

from making.data.__main__ import write_data
from making.data.designs import Design, designs, surfaces
from making.data.shading import SIDE
from pipeline.world.images import read_image

pytestmark = pytest.mark.slow

DATA = Path("data")
SAMPLE = {(design.symbol, design.split): design for design in designs()}  # all would take longer than 10 s
TOPS = {"grey": ("train", lambda: np.full((SIDE, SIDE, 3), 128, np.uint8))}


def painted(name: str) -> Design:
    """A grey item."""
    return Design(name, "bowl", "train", 0.05, 0.0, lambda: np.full((SIDE, SIDE, 4), 128, np.uint8))


def contents(directory: Path) -> dict[str, bytes]:
    return {str(p.relative_to(directory)): p.read_bytes() for p in directory.rglob("*") if p.is_file()}


@pytest.mark.parametrize(
    ("file", "draw"),
    [(f"items/{design.name}.png", design.draw) for design in SAMPLE.values()]
    + [(f"textures/{name}.png", draw) for name, (_, draw) in surfaces().items()],
)
def test_data_holds_what_the_script_draws(file, draw):
    """To one grey level: libm may round otherwise on another machine."""
    stored = read_image(DATA / file).astype(int)
    assert np.abs(stored - draw()).max() <= 1


def test_drawing_anew_removes_old_images_and_a_drawing_that_fails_removes_none(tmp_path):
    def fail() -> np.ndarray:
        raise RuntimeError("no such colour")

    write_data(tmp_path, [painted("old")], TOPS)
    write_data(tmp_path, [painted("new")], TOPS)
    before = contents(tmp_path)
    assert set(before) == {"items.csv", "textures.csv", "items/new.png", "textures/grey.png"}
    with pytest.raises(RuntimeError, match="no such colour"):
        write_data(tmp_path, [painted("newer")], {"broken": ("train", fail)})
    assert contents(tmp_path) == before
