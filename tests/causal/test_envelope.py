"""A radius is the clearance at which half of the effect is gone; its interval covers it as often as promised."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from pipeline.causal.envelope import dose_grid, radius
from pipeline.stats.crossed import by_item

STEP, DOSES = 0.005, 20
GRID = dose_grid(STEP, DOSES)
MARGIN = 0.045


def steps(margin: float, height: float = 1.0) -> np.ndarray:
    """(2 seeds, 3 scenes, dose): every path nearer than the margin loses `height`."""
    below = np.clip((margin - GRID) / STEP + 0.5, 0, 1)  # share of each interval that lies within the margin
    return np.broadcast_to(height * below, (2, 3, DOSES))


def responses(g: np.random.Generator, by_seed: float, by_scene: float, margin: np.ndarray) -> np.ndarray:
    """(10 seeds, 60 scenes, dose): normal curves [m] around margins that differ by seed and scene, with gaps."""
    dose = GRID + g.uniform(-STEP / 2, STEP / 2, (60, DOSES))
    margin = margin + by_seed * g.normal(size=(10, 1, 1)) + by_scene * g.normal(size=(1, 60, 1))
    height = 0.8 + 0.1 * g.uniform(-1, 1, (10, 1, 1)) + 0.1 * g.uniform(-1, 1, (1, 60, 1))
    response = height * norm.cdf((margin + 0.003 * g.normal(size=(10, 60, DOSES)) - dose) / 0.006)
    gone = g.random((60, DOSES)) < 0.3
    gone[:, 0] = False
    return np.where(gone, np.nan, response)


def covers_margin(response: np.ndarray) -> bool:
    _, low, high = radius(response, GRID)
    return low <= MARGIN <= high


@settings(max_examples=25, deadline=None)
@given(st.floats(0.005, 0.09), st.floats(0.2, 1.0))
def test_a_step_of_any_height_is_located_within_a_tenth_of_the_dose_step(margin: float, height: float):
    middle, low, high = radius(steps(margin, height), GRID)
    assert abs(middle - margin) < STEP / 10
    assert low == pytest.approx(middle) and high == pytest.approx(middle)


@pytest.mark.slow
def test_intervals_over_items_cover_differing_items_and_those_over_scenes_do_not():
    """Six items in sixty scenes; each is seen too wide or too narrow in all of its scenes."""
    g, item = np.random.default_rng(11), np.arange(60) % 6
    over_items, over_scenes = [], []
    for i in range(400):
        wider = 0.006 * g.normal(size=6)
        response = responses(g, 0.002, 0.003, MARGIN + wider[item][:, None])
        over_items.append(covers_margin(by_item(response, item)))
        if i < 100:
            over_scenes.append(covers_margin(response))
    assert 0.92 <= np.mean(over_items) <= 0.985  # 0.95, and nearly three of its own errors either way
    assert np.mean(over_scenes) < 0.8
