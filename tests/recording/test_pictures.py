"""The README's pictures of recordings are there, each shown and described, and none is blank."""

import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
SHOWN = re.findall(r"!\[([^\]]+)\]\((docs/pictures/[^)]+\.png)\)", (ROOT / "README.md").read_text())


def test_the_readme_shows_and_describes_every_picture_and_make_makes_it():
    made = set(re.findall(r"docs/pictures/\S+\.png", (ROOT / "Makefile").read_text()))
    there = {str(path.relative_to(ROOT)) for path in (ROOT / "docs/pictures").iterdir()}
    assert made == there == {path for _, path in SHOWN}
    assert all(len(words) > 40 for words, _ in SHOWN)


@pytest.mark.parametrize("path", [path for _, path in SHOWN])
def test_a_picture_is_not_blank(path: str):
    with Image.open(ROOT / path) as image:
        pixels = np.asarray(image.convert("RGB"))
    tab = pixels[80:-60, : int(0.78 * pixels.shape[1])]  # without the page beside it
    assert pixels.shape == (1080, 1920, 3)
    assert tab.std() > 20 and len(np.unique(tab.reshape(-1, 3), axis=0)) > 500
