"""Clearances in three dimensions agree with plane geometry, and with physics."""

import numpy as np
import pytest

from pipeline.robot.carried import Part, clearances, simulate
from pipeline.world.layout import SYMBOLS, empty

SIDE_M, GRIP_M = 0.6, 0.155
HEIGHTS = {"bowl": 0.06, "plate": 0.02, "cutlery": 0.01, "glass": 0.12}
MASSES = dict.fromkeys(HEIGHTS, 0.2)
SHAKER = Part(0.0, 0.0, 0.02, 0.14, 0.02)  # its lower edge is 1.5 cm above the table
X = np.linspace(0.1, 0.9, 50) * SIDE_M
GRIP = np.stack([X, np.full(50, SIDE_M / 2), np.full(50, GRIP_M)], -1)  # straight across the middle of the table
HEADING = np.zeros(50)


@pytest.mark.parametrize(
    ("symbol", "y", "expected"),
    [
        ("glass", 0.7, 0.6 * 0.15 - 0.02),  # beside a tall item: the distance in the plane
        ("glass", 0.62, 0.6 * 0.07 - 0.02),
        ("cutlery", 0.5, 0.015 - 0.6 * 0.01),  # over a flat one: the height above it
        ("plate", 0.5, 0.015 - 0.6 * 0.02),
        ("glass", 0.5, -0.6 * 0.05 - 0.02),  # through a tall one: negative
    ],
)
def test_a_clearance_is_a_distance_aside_or_above_and_physics_touches_what_has_none(symbol, y: float, expected: float):
    layouts = empty(1, 2)
    layouts.symbol[0, 0], layouts.centre[0, 0], layouts.radius[0, 0] = SYMBOLS.index(symbol), (0.5, y), 0.05
    least = clearances(SHAKER, GRIP[None], HEADING[None], layouts, SIDE_M, HEIGHTS)
    assert least[0, 0] == pytest.approx(expected, abs=6e-3) and np.isinf(least[0, 1])
    touched, _ = simulate(layouts, 0, SIDE_M, HEIGHTS, MASSES, [SHAKER], GRIP, HEADING, 2.0)
    assert touched.tolist() == [least[0, 0] < 0, False]
