"""Refuters change what they say they change, and find nothing where there is nothing."""

import numpy as np
import pytest

from pipeline.causal.refuters import REFUTERS, halves, mean_over, placebo, stays_over_items
from pipeline.stats.crossed import SMALLEST_EFFECT


def test_a_placebo_has_the_items_pixels_in_the_items_place_and_touches_nothing_else():
    rng = np.random.default_rng(0)
    before = rng.integers(0, 256, (3, 100, 100, 3), dtype=np.uint8)
    after = before.copy()
    after[:, 20:40, 30:50] = rng.integers(0, 256, (3, 20, 20, 3), dtype=np.uint8)
    patched = placebo(rng, before, after)
    for old, new, found in zip(before, after, patched, strict=True):
        changed = (old != new).any(-1)
        np.testing.assert_array_equal(found[~changed], old[~changed])
        assert sorted(map(tuple, found[changed])) == sorted(map(tuple, new[changed]))
        assert (found[changed] != new[changed]).any(-1).mean() > 0.9
    np.testing.assert_array_equal(placebo(rng, before, before), before)


def test_a_mosaic_keeps_its_pieces_whole():
    """Inside by squares, at the rim pixel by pixel; every pixel of the item is there again."""
    rng = np.random.default_rng(1)
    before = np.zeros((1, 100, 100, 3), np.uint8)
    after = before.copy()
    after[0, 21:40, 30:51] = rng.integers(1, 256, (19, 21, 3), dtype=np.uint8)
    (patched,) = placebo(rng, before, after, piece=2)
    assert sorted(map(tuple, patched.reshape(-1, 3))) == sorted(map(tuple, after[0].reshape(-1, 3)))
    np.testing.assert_array_equal(patched.any(-1), after[0].any(-1))

    def squares(picture: np.ndarray) -> list[bytes]:
        inside = picture[22:40, 30:50]  # squares on even pixels that the item fills
        return sorted(inside[y : y + 2, x : x + 2].tobytes() for y in range(0, 18, 2) for x in range(0, 20, 2))

    assert squares(patched) == squares(after[0])
    assert (patched[22:40, 30:50] != after[0, 22:40, 30:50]).any(-1).mean() > 0.9


def test_a_mean_over_chosen_paths_leaves_the_others_out():
    p = np.array([[0.1, 0.3, 0.9], [0.2, 0.4, 0.6]])
    chosen = np.array([[True, True, False], [False, False, False]])
    np.testing.assert_allclose(mean_over(p, chosen), [0.2, np.nan])
    np.testing.assert_allclose(mean_over(p, np.ones(3, bool)), p.mean(-1))


def test_clear_effects_keep_their_verdict_in_every_half_and_borderline_ones_do_not():
    rng = np.random.default_rng(0)
    scenes = rng.normal(0, 0.1, (3, 1, 100)) + rng.normal(0, 0.01, (3, 10, 100))
    scenes -= scenes.mean((1, 2), keepdims=True)
    effects = scenes + np.array([0.3, 0.0, 0.9 * SMALLEST_EFFECT])[:, None, None]
    same, spread = halves(rng, effects, 100)
    assert same[0] == 1 and same[1] > 0.95
    assert same[2] < same[1]
    expected = 0.1 / np.sqrt(100)  # of half of 100 scenes, drawn without replacement
    np.testing.assert_allclose(spread, expected, rtol=0.35)


def test_too_few_scenes_to_halve_are_refused():
    with pytest.raises(ValueError, match="3 scenes in 10 splits: expected at least 4"):
        halves(np.random.default_rng(0), np.zeros((1, 2, 3)), 10)


def test_an_effect_of_one_item_alone_stays_an_effect_over_scenes_and_not_over_items():
    rng, item = np.random.default_rng(1), np.arange(120) % 6
    noise = rng.normal(0, 0.05, (3, 10, 120))
    of_one, of_all, of_none = 0.6 * (item == 2), np.full(120, 0.1), np.zeros(120)
    effects = noise + np.stack([of_one, of_all, of_none])[:, None]
    np.testing.assert_array_equal(stays_over_items(effects, np.tile(item, (3, 1))), [False, True, True])


def test_every_refuter_says_what_is_done_asked_and_read():
    for refuter in REFUTERS.values():
        for sentence in (refuter.null, refuter.reading):
            assert sentence[0].isupper() and sentence.endswith(".") and sentence.count(".") == 1
        assert refuter.reading.startswith("A small p means")
