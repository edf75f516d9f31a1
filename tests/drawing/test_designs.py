"""Drawing is repeatable, and data/ is what the script draws."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from drawing.__main__ import write_data
from drawing.crockery import bowl
from drawing.designs import Design, designs, surfaces
from drawing.shading import SIDE
from drawing.surface import surface
from pipeline.world.images import read_image
from pipeline.world.layout import SYMBOLS

pytestmark = pytest.mark.slow

DATA = Path("data")
ONE_OF_EACH = {design.symbol: design for design in designs()}
SAMPLE = {(design.symbol, design.split): design for design in designs()}  # all would take longer than 10 s
GREY, BLACK = (128, 128, 128), (0, 0, 0)
TOPS = {"grey": ("train", lambda: np.full((SIDE, SIDE, 3), GREY, np.uint8))}


def painted(name: str, symbol: str = "bowl", colour: tuple[int, int, int] = GREY) -> Design:
    """An item of one colour all over."""
    return Design(name, symbol, "train", 0.05, 0.0, lambda: np.full((SIDE, SIDE, 4), (*colour, 255), np.uint8))


def contents(directory: Path) -> dict[str, bytes]:
    return {str(p.relative_to(directory)): p.read_bytes() for p in directory.rglob("*") if p.is_file()}


@pytest.mark.parametrize("symbol", SYMBOLS)
def test_an_item_drawn_twice_is_the_same_to_the_last_bit(symbol):
    np.testing.assert_array_equal(ONE_OF_EACH[symbol].draw(), ONE_OF_EACH[symbol].draw())


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
    assert set(contents(DATA)) == {"items.csv", "textures.csv", *images}
    table = pd.read_csv(DATA / "items.csv")
    assert [*zip(table["name"], table["split"], strict=True)] == [(design.name, design.split) for design in designs()]
    np.testing.assert_allclose(table["width_m"], [design.width_m for design in designs()], atol=5e-5)
    assert pd.read_csv(DATA / "textures.csv")["name"].tolist() == list(surfaces())


def test_drawing_anew_removes_old_images_and_those_of_a_killed_run(tmp_path):
    write_data(tmp_path, [painted("kept"), painted("renamed")], TOPS)
    (tmp_path / ".part").mkdir()
    (tmp_path / ".part" / "half.png").touch()
    (tmp_path / "notes.txt").touch()  # not drawn, so left alone
    write_data(tmp_path, [painted("kept"), painted("new")], {"other": TOPS["grey"]})
    assert set(contents(tmp_path)) == {
        "items.csv", "textures.csv", "items/kept.png", "items/new.png", "textures/other.png", "notes.txt"
    }  # fmt: skip
    assert pd.read_csv(tmp_path / "items.csv")["name"].tolist() == ["kept", "new"]


def test_a_drawing_that_fails_leaves_the_folder_as_it_was(tmp_path):
    write_data(tmp_path, [painted("bowl")], TOPS)
    before = contents(tmp_path)

    def fail() -> np.ndarray:
        raise RuntimeError("no such colour")

    with pytest.raises(RuntimeError, match="no such colour"):
        write_data(tmp_path, [painted("bowl", colour=BLACK), painted("new")], {"broken": ("train", fail)})
    assert contents(tmp_path) == before


def test_random_items_are_validation_items_no_larger_than_the_training_ones():
    listed, more = designs(), designs(30, seed=3)
    for symbol in SYMBOLS:
        random = [design for design in more if design.symbol == symbol][-30:]
        trained = [design for design in listed if design.symbol == symbol and design.split == "train"]
        assert {design.split for design in random} == {"validation"}
        assert max(design.radius_m for design in random) <= max(design.radius_m for design in trained)
    names = [design.name for design in listed]
    assert [design.name for design in more if design.name in names] == names


def test_more_random_items_begin_with_the_fewer():
    few, many = ({design.name: design for design in designs(more, seed=3)} for more in (1, 30))
    for name in (name for name in few if name.endswith("-r0")):
        np.testing.assert_array_equal(few[name].draw(), many[name].draw())


def test_random_table_tops_are_validation_tops_and_differ_with_the_seed():
    listed, more, other = surfaces(), surfaces(9, seed=3), surfaces(9, seed=4)
    assert list(more)[: len(listed)] == list(listed) and len(more) == len(listed) + 9
    for name in list(more)[len(listed) :]:
        (split, draw), (_, draw_other) = more[name], other[name]
        assert split == "validation"
        top = draw()
        np.testing.assert_array_equal(top, draw())
        assert np.ptp(top.reshape(-1, 3), axis=0).max() > 10  # a pattern is there to be seen
        assert not np.array_equal(top, draw_other())


@pytest.mark.parametrize(
    ("asked", "answer"),
    [
        (["--more", "2"], "expected a count from 1 and a folder other than data"),
        (["--more", "2", "--into", str(DATA.resolve())], "expected a count from 1 and a folder other than data"),
        (["--more", "-2", "--into", "elsewhere"], "expected a count from 1 and a folder other than data"),
        (["--seed", "-1", "--into", "elsewhere"], "expected a whole number from 0"),
        (["--contact-sheet", "sheet.png", "--into", "nowhere"], "nowhere holds no items.csv"),
    ],
)
def test_wrong_requests_are_refused_and_nothing_is_drawn(asked, answer):
    before = DATA.joinpath("items.csv").read_bytes()
    refused = subprocess.run([sys.executable, "-m", "drawing", *asked], capture_output=True, text=True, timeout=120)
    assert refused.returncode == 2 and answer in refused.stderr
    assert DATA.joinpath("items.csv").read_bytes() == before and not Path("elsewhere").exists()


def test_a_bowl_is_deeper_in_the_middle_than_at_its_rim():
    """Depth, seen as shade, tells a white bowl from a white plate."""
    rgba = bowl(0, (0.9, 0.9, 0.9), (0.9, 0.9, 0.9), (0.2, 0.2, 0.2), "plain", 0.55).astype(float)
    axis = (np.arange(len(rgba)) + 0.5) / len(rgba) * 2 - 1
    r = np.hypot(*np.meshgrid(axis, axis))
    assert rgba[r < 0.3][:, :3].mean() < 0.85 * rgba[(r > 0.85) & (r < 0.95)][:, :3].mean()


def test_an_unknown_pattern_or_table_top_is_refused():
    grey = (0.5, 0.5, 0.5)
    with pytest.raises(ValueError, match="unknown pattern 'stars'"):
        bowl(0, grey, grey, grey, "stars", 0.5)
    with pytest.raises(ValueError, match="unknown table top 'grass'"):
        surface(0, "grass", grey, grey)
