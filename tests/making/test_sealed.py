"""Seeds of sealed draws follow from what was expected of them."""

import re

import pytest

from making.sealed import EXPECTATIONS, drawn, sealed_seed
from pipeline.runtime.places import ROOT


def test_each_byte_of_the_expectations_and_the_name_decide_a_seed():
    seeds = [sealed_seed(file, draw) for file in (b"0.97\n", b"0.98\n") for draw in ("scenes.root_seed", "seeds.1")]
    assert seeds == [1299601150, 1221, 580985977, 1791]


def test_every_sealed_draw_has_the_seed_of_the_committed_expectations():
    expectations = EXPECTATIONS.read_bytes()
    assert drawn() == {draw: sealed_seed(expectations, draw) for draw in drawn()}


def test_make_render_has_the_seeds_of_the_pictures():
    folder = ROOT / "rendered/pictures"
    if not folder.is_dir():
        pytest.skip(f"{folder} is absent: make data-here")
    in_makefile = dict(re.findall(r"((?:train|validation|test)\w*) (\d+)", (ROOT / "Makefile").read_text()))
    sources = {file.parent.name: file.read_text(encoding="utf-8") for file in folder.glob("*/SOURCE.md")}
    assert in_makefile == {name: re.findall(r"--seed (\d+)", source)[0] for name, source in sources.items()}
