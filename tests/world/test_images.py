"""Images come back as they were written; what cannot be used is refused before it is decoded."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from pipeline.runtime.errors import InputError
from pipeline.world.images import image_size, read_image, write_png


def noise(*shape: int) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)


@pytest.mark.parametrize("channels", [3, 4])
def test_a_png_comes_back_as_it_was(tmp_path: Path, channels: int):
    pixels = noise(20, 30, channels)
    write_png(tmp_path / "a.png", pixels)
    np.testing.assert_array_equal(read_image(tmp_path / "a.png"), pixels)
    assert image_size(tmp_path / "a.png") == (30, 20)


def test_a_jpeg_is_read_as_rgb_and_a_grey_image_has_three_channels(tmp_path: Path):
    red = np.full((20, 30, 3), (0, 0, 255), np.uint8)  # blue first, as OpenCV writes
    cv2.imwrite(str(tmp_path / "a.jpg"), red)
    assert image_size(tmp_path / "a.jpg") == (30, 20)
    np.testing.assert_allclose(read_image(tmp_path / "a.jpg"), red[..., ::-1], atol=3)
    cv2.imwrite(str(tmp_path / "a.png"), noise(20, 30))
    assert read_image(tmp_path / "a.png").shape == (20, 30, 3)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.5])
def test_a_truncated_file_is_refused(tmp_path: Path, suffix: str, share: float):
    path = tmp_path / f"a{suffix}"
    cv2.imwrite(str(path), noise(64, 64, 3))
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    with pytest.raises(InputError, match="truncated"):
        read_image(path)
