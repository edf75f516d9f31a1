"""Refuters change what they say they change, and find no effect where there is none."""

import numpy as np

from pipeline.causal.interventions import estimate_effects
from pipeline.causal.refuters import data_subset, placebo_patch
from pipeline.stats.tests import SMALLEST_EFFECT


def test_a_placebo_keeps_the_item_s_pixels_in_its_place_and_squares_that_the_item_fills_whole():
    rng = np.random.default_rng(1)
    before = np.zeros((1, 100, 100, 3), np.uint8)
    after = before.copy()
    after[0, 21:40, 30:51] = rng.integers(1, 256, (19, 21, 3), dtype=np.uint8)
    (patched,) = placebo_patch(rng, before, after, piece=2)
    assert sorted(map(tuple, patched.reshape(-1, 3))) == sorted(map(tuple, after[0].reshape(-1, 3)))
    np.testing.assert_array_equal(patched.any(-1), after[0].any(-1))

    def squares(image: np.ndarray) -> list[bytes]:
        inside = image[22:40, 30:50]  # squares on even pixels that the item fills
        return sorted(inside[y : y + 2, x : x + 2].tobytes() for y in range(0, 18, 2) for x in range(0, 20, 2))

    assert squares(patched) == squares(after[0])
    assert (patched[22:40, 30:50] != after[0, 22:40, 30:50]).any(-1).mean() > 0.9


def test_clear_effects_keep_their_verdict_in_every_half_and_borderline_ones_do_not():
    rng = np.random.default_rng(0)
    scenes = rng.normal(0, 0.1, (3, 1, 100)) + rng.normal(0, 0.01, (3, 10, 100))
    scenes -= scenes.mean((1, 2), keepdims=True)
    effects = scenes + np.array([0.3, 0.0, 0.9 * SMALLEST_EFFECT])[:, None, None]
    items = np.tile(np.arange(100)[:, None] % 50 == np.arange(50), (3, 1, 1)).astype(int)
    table = data_subset(rng, effects, 100, items)
    assert list(table["expected"]) == list(estimate_effects(effects, items)["verdict"])
    agreement = table["agreement"]
    assert agreement[0] == 1 and agreement[1] > 0.95 and agreement[2] < agreement[1]
    assert table["verdict"][0] == "effect" and table["verdict"][1] == "negligible"
    width = 2 * 1.96 * 0.1 / np.sqrt(100)  # of half of 100 scenes, drawn without replacement
    np.testing.assert_allclose(table["ci_high"] - table["ci_low"], width, rtol=0.35)
