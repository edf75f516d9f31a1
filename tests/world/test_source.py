"""A render seed decides light, camera and pattern; each effect of the wide source can be turned off alone."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SIDE, SYMBOLS, Layouts, empty
from pipeline.world.patterns import PATTERNS
from pipeline.world.render import REACH_M, Palette, render
from pipeline.world.source import DRAWN, ImageSource, Pattern, draw_light
from pipeline.world.symbols import APPEARANCES
from tests.factories import composed
from tests.world.test_render import centroid, disc_catalogue, with_item

WIDE = ImageSource.of(composed("source=wide").scenes.source)
CATALOGUE = read_catalogue(Path("data"))
FIRST = {s: int(np.flatnonzero(CATALOGUE.items["symbol"] == s)[0]) for s in SYMBOLS}
BLUR_M = 0.03  # the camera's tilt, the lens and a pixel that is touched in part spread a change by up to 3 px
OTHER_FIELD = {  # parameter -> the fields of a scene's light that it decides, where their names differ
    "exposure": {"gain"}, "white_balance": {"gain"}, "tilt_px": {"view"},
    "pattern_chance": {"pattern", "offset"}, "fold_chance": {"pattern"}, "patterns": {"pattern"},
}  # fmt: skip
EFFECTS = [f.name for f in fields(ImageSource) if getattr(WIDE, f.name) != getattr(DRAWN, f.name)]


def table(glass: bool = True) -> Layouts:
    """A scene with a bowl and, unless left out, a glass."""
    layouts = with_item(empty(1, 4), 0, CATALOGUE, FIRST["bowl"], 0.35, 0.7, 0.4)
    return with_item(layouts, 1, CATALOGUE, FIRST["glass"], 0.66, 0.38) if glass else layouts


def picture(source: ImageSource, layouts: Layouts, seed: int = 0) -> np.ndarray:
    return render(layouts, 0, "oak", seed, Palette(CATALOGUE, source))


def differing(a: object, b: object) -> set[str]:
    """Names of the fields in which two lights differ."""
    return {f.name for f in fields(a) if not np.array_equal(getattr(a, f.name), getattr(b, f.name))}  # pyright: ignore


def test_the_configured_drawn_source_is_the_library_s_default():
    assert ImageSource.of(composed().scenes.source) == DRAWN


def test_the_drawn_source_draws_the_light_that_it_drew_before_there_were_others():
    light = draw_light(7)
    np.testing.assert_allclose([*light.offset, light.rotation], [0.89721380, 0.77568569, -1.72657415], atol=1e-7)
    np.testing.assert_allclose(light.gain, [0.90307903, 0.92742896, 0.95706379], atol=1e-7)
    np.testing.assert_allclose([light.fall_off, light.vignette], [0.09970694, 0.05743480], atol=1e-7)
    np.testing.assert_allclose(light.noise[-1, -1], [0.01445460, -0.00689928, 0.02446181], atol=1e-7)
    assert light.pattern is None and light.view is None


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_alone_changes_the_picture_and_leaves_all_else_that_the_seed_decides(effect: str):
    alone = replace(DRAWN, **{effect: getattr(WIDE, effect)})
    if effect == "shadow_softness":
        alone = replace(alone, shadow_length=(4.0, 4.0))
    if effect == "fold_chance":
        alone = replace(alone, pattern_chance=1.0, patterns=("weave",))
    off = replace(alone, **{effect: getattr(DRAWN, effect)})
    assert any((picture(alone, table(), seed) != picture(off, table(), seed)).any() for seed in range(6))
    for seed in range(6):
        without = draw_light(seed, replace(WIDE, **{effect: getattr(DRAWN, effect)}))
        assert differing(draw_light(seed, WIDE), without) <= OTHER_FIELD.get(effect, {effect})


@pytest.mark.parametrize("symbol", SYMBOLS)
def test_an_added_item_changes_a_wide_picture_only_as_far_as_its_shadow_reaches(symbol: str):
    for seed in range(6):
        light, height = draw_light(seed, WIDE), APPEARANCES[SYMBOLS.index(symbol)].height_m
        after = with_item(table(glass=False), 1, CATALOGUE, FIRST[symbol], 0.66, 0.38, 1.1)
        rows, columns = np.nonzero((picture(WIDE, table(glass=False), seed) != picture(WIDE, after, seed)).any(-1))
        assert len(rows) > 20
        reach = after.radius[0, 1] + after.half_length[0, 1] + BLUR_M
        reach += max(REACH_M, height * light.shadow_length * (1 + 3 * light.shadow_softness) + REACH_M / 2)
        away = np.abs([(columns + 0.5) / SIDE - 0.66, 1 - (rows + 0.5) / SIDE - 0.38])
        assert away.max() < reach < 0.4


def test_a_glass_refracts_only_the_table_within_its_footprint():
    source = replace(DRAWN, pattern_chance=1.0, patterns=("check",))
    plain, bent = (picture(replace(source, refraction=(r, r)), table()) for r in (0.0, 0.6))
    rows, columns = np.nonzero((plain != bent).any(-1))
    away = np.hypot((columns + 0.5) / SIDE - 0.66, 1 - (rows + 0.5) / SIDE - 0.38)
    assert len(rows) > 20 and away.max() < table().radius[0, 1] + 0.02


def test_perspective_moves_an_item_by_at_most_some_two_pixels():
    catalogue, source = disc_catalogue(), replace(DRAWN, parallax=WIDE.parallax, tilt_px=WIDE.tilt_px)
    away = []
    for seed in range(20):
        layouts = with_item(empty(1, 4), 0, catalogue, 0, 0.2, 0.8)
        image = render(layouts, 0, "grey", seed, Palette(catalogue, source)).astype(float)
        away.append(np.hypot(*(centroid(np.clip(image[..., 0] - image[..., 1] - 60, 0, None)) - [0.2, 0.8])))
    assert 0.002 < np.mean(away) < 0.01 and max(away) < 0.02


@pytest.mark.parametrize("name", PATTERNS)
def test_every_pattern_shows_the_same_top_again_within_the_range_of_brightness(name: str):
    one, again, other = (Pattern(name, seed, False).draw(90) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert one.shape == (90, 90, 3) and 0 <= one.min() <= one.max() < 1
    assert (one != other).any()


def test_folds_shade_a_cloth():
    plain, folded = (np.stack([Pattern("weave", s, folds).draw(90) for s in range(8)]) for folds in (False, True))
    assert np.abs(plain - folded).max((1, 2, 3)).mean() > 0.03
