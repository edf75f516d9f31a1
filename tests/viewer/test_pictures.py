"""The README's pictures of recordings are there, of this commit's, each shown and described, and none is blank."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.artifacts.files import read_table
from pipeline.runtime.errors import InputError
from pipeline.viewer.screenshot import Screenshot, read_png, write_png

ROOT = Path(__file__).resolve().parents[2]
SHOWN = re.findall(r"!\[([^\]]+)\]\((docs/pictures/[^)]+\.png)\)", (ROOT / "README.md").read_text())


def test_the_readme_shows_and_describes_every_picture_and_make_makes_it():
    made = set(re.findall(r"docs/pictures/\S+\.png", (ROOT / "Makefile").read_text()))
    there = {str(path.relative_to(ROOT)) for path in (ROOT / "docs/pictures").iterdir()}
    assert made == there == {path for _, path in SHOWN}
    assert all(len(words) > 40 for words, _ in SHOWN)


@pytest.mark.parametrize("path", [path for _, path in SHOWN])
def test_a_picture_is_of_a_recording_of_this_commit(path: str):
    shot, recorded = read_png(ROOT / path), read_table(ROOT / "outputs/record/recordings.csv").set_index("run")
    assert shot.contents == recorded.loc[shot.recording, "sha256"]


def test_a_picture_comes_back_with_what_it_shows(tmp_path: Path):
    shot = Screenshot(Image.new("RGB", (3, 2), "teal"), "full-careful-s0", "1234")
    write_png(tmp_path / "one.png", shot)
    read = read_png(tmp_path / "one.png")
    assert (read.recording, read.contents) == (shot.recording, shot.contents)
    assert read.image.tobytes() == shot.image.tobytes()


def test_any_other_png_is_refused(tmp_path: Path):
    Image.new("RGB", (3, 2)).save(tmp_path / "other.png")
    with pytest.raises(InputError, match=r"other\.png is not a picture of a recording"):
        read_png(tmp_path / "other.png")


@pytest.mark.parametrize("kept", [0, 20, 200])
def test_a_picture_cut_off_is_refused(tmp_path: Path, kept: int):
    (tmp_path / "cut.png").write_bytes((ROOT / SHOWN[0][1]).read_bytes()[:kept])
    with pytest.raises(InputError, match=r"cut\.png is not a picture of a recording"):
        read_png(tmp_path / "cut.png")


def test_a_picture_that_would_fill_the_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    shot = Screenshot(Image.new("RGB", (300, 200)), "overview", "1234")
    write_png(tmp_path / "vast.png", shot)
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1000)
    with pytest.raises(InputError, match=r"vast\.png is not a picture of a recording .*decompression bomb"):
        read_png(tmp_path / "vast.png")


def test_a_picture_into_a_folder_that_is_not_there_is_refused_in_one_line(tmp_path: Path):
    file = tmp_path / "missing" / "one.png"
    command = [sys.executable, "-m", "pipeline.viewer.picture", "overview", str(file)]
    refused = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert refused.returncode == 2
    assert refused.stderr == f"error: there is no folder {file.parent} to write {file} into: make it first\n"


@pytest.mark.parametrize("path", [path for _, path in SHOWN])
def test_a_picture_is_not_blank(path: str):
    pixels = np.asarray(read_png(ROOT / path).image)
    tab = pixels[80:-60, : int(0.78 * pixels.shape[1])]  # without the page beside it
    assert pixels.shape == (1080, 1920, 3)
    assert tab.std() > 20 and len(np.unique(tab.reshape(-1, 3), axis=0)) > 500
