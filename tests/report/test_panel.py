"""What the page's panel is given: maps, truth, footprints and repairs as the stages have them."""

import base64
import io
import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from pipeline.report.panel import Ascents, Scene, panel, script_json
from pipeline.table.bezier import lattice, random_z_theta
from pipeline.table.layout import SYMBOLS, Layouts, add_item, random_layouts
from pipeline.table.rules import valid
from tests.examples import RULES
from tests.report_artefacts import ITEMS

SIDE = 9
VARIANTS = ["full", "path"]
USERS = {"careful": dict.fromkeys(SYMBOLS, 0.045), "normal": dict.fromkeys(SYMBOLS, None) | {"glass": 0.042}}


@pytest.fixture(scope="module")
def scene() -> Scene:
    rng = np.random.default_rng(1)
    bare = random_layouts(rng, 1, ITEMS, np.arange(4), RULES)
    layouts = [bare, *(add_item(rng, bare, symbol, ITEMS, np.arange(4), RULES) for symbol in range(4))]
    stacked = Layouts(*(np.concatenate(parts) for parts in zip(*(vars(x).values() for x in layouts), strict=True)))
    images = rng.integers(0, 255, (5, 1, 1, 3), np.uint8).repeat(100, 1).repeat(100, 2)
    maps = {u: {v: rng.random((5, SIDE**2), np.float32) for v in VARIANTS} for u in USERS}
    ascents = {
        u: {v: Ascents(np.array([2, 5]), random_z_theta(rng, 2, 4), rng.random((2, 4), np.float32)) for v in VARIANTS}
        for u in USERS
    }
    return Scene("Scene 1", list(SYMBOLS), images, stacked, maps, ascents)


@pytest.fixture(scope="module")
def packed(scene: Scene) -> dict:
    """The scene as the page's script reads it."""
    data = json.loads(script_json(panel({"new_items": [scene]}, USERS, VARIANTS, SIDE)))
    return data["splits"][0]["scenes"][0]


def unpacked(text: str, dtype: str = "u1") -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype)


def test_a_map_comes_back_as_the_models_probabilities(scene: Scene, packed: dict):
    for i, table in enumerate(packed["tables"]):
        for by_variant, user in zip(table["maps"], USERS, strict=True):
            for text, variant in zip(by_variant, VARIANTS, strict=True):
                np.testing.assert_allclose(unpacked(text) / 255, scene.maps[user][variant][i], atol=0.5 / 255 + 1e-6)


def test_the_true_map_is_the_users_rule(scene: Scene, packed: dict):
    cells = np.broadcast_to(lattice(SIDE), (5, SIDE**2, 2))
    for u, margins in enumerate(USERS.values()):
        truth = [np.unpackbits(unpacked(table["truth"][u]), count=SIDE**2) for table in packed["tables"]]
        np.testing.assert_array_equal(truth, valid(scene.layouts, cells, margins))


def test_items_are_the_layouts_and_the_added_one_comes_last(scene: Scene, packed: dict):
    assert [table["added"] for table in packed["tables"]] == [None, *SYMBOLS]
    before = packed["tables"][0]["items"]
    for i, table in enumerate(packed["tables"]):
        there = scene.layouts.present[i]
        np.testing.assert_allclose([x["ends"] for x in table["items"]], scene.layouts.ends[i][there], atol=6e-6)
        np.testing.assert_allclose([x["radius"] for x in table["items"]], scene.layouts.radius[i][there], atol=6e-6)
        assert [x["symbol"] for x in table["items"]] == [SYMBOLS[s] for s in scene.layouts.symbol[i][there]]
        if i:
            assert table["items"][:-1] == before and table["items"][-1]["symbol"] == table["added"]


def test_repairs_keep_their_steps(scene: Scene, packed: dict):
    for u, user in enumerate(USERS):
        assert packed["repairs"][u]["starts"] == [2, 5]
        for ascent, variant in zip(packed["repairs"][u]["ascents"], VARIANTS, strict=True):
            z, p = unpacked(ascent["z"], "<i2").reshape(2, 4, 2), unpacked(ascent["p"]).reshape(2, 4)
            np.testing.assert_allclose(z * 1e-4, scene.repairs[user][variant].z, atol=5.1e-5)
            np.testing.assert_allclose(p / 255, scene.repairs[user][variant].p, atol=0.5 / 255 + 1e-6)


def test_pictures_show_the_tables(scene: Scene, packed: dict):
    for image, table in zip(scene.images, packed["tables"], strict=True):
        content = base64.b64decode(table["picture"].removeprefix("data:image/webp;base64,"))
        with Image.open(io.BytesIO(content)) as picture:
            np.testing.assert_allclose(np.asarray(picture.convert("RGB"), float), image, atol=6)


def test_the_palette_grows_lighter_with_probability(scene: Scene):
    palette = unpacked(panel({"new_items": [scene]}, USERS, VARIANTS, SIDE)["palette"]).reshape(256, 3)
    lightness = palette.astype(float) @ (0.2126, 0.7152, 0.0722)
    assert all(one < other + 1 for one, other in pairwise(lightness))


@given(st.text("</script>!-a"))
def test_no_word_ends_the_element_that_holds_the_data(word: str):
    text = script_json({"label": f"</script>{word}"})
    assert "<" not in text and json.loads(text)["label"] == f"</script>{word}"
