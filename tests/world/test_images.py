"""Images come back as they were written."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.world.images import image_size, read_image, write_png


@pytest.mark.parametrize("channels", [3, 4])
def test_a_png_comes_back_as_it_was(tmp_path: Path, channels: int):
    pixels = np.random.default_rng(0).integers(0, 256, (20, 30, channels), dtype=np.uint8)
    write_png(tmp_path / "a.png", pixels)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), pixels)
    assert image_size(tmp_path / "a.png") == (30, 20)
