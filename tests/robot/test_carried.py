"""Physics touches what stands in the way, and nothing that a part passes beside or above."""

import numpy as np
import pytest

from pipeline.robot.carried import Part, simulate
from pipeline.world.layout import SYMBOLS, empty

SIDE_M, GRIP_M = 0.6, 0.155
HEIGHTS = {"bowl": 0.06, "plate": 0.02, "cutlery": 0.01, "glass": 0.12}
MASSES = dict.fromkeys(HEIGHTS, 0.2)
SHAKER = Part(0.0, 0.0, 0.02, 0.14, 0.02)  # its lower edge is 1.5 cm above the table
X = np.linspace(0.1, 0.9, 50) * SIDE_M
GRIP = np.stack([X, np.full(50, SIDE_M / 2), np.full(50, GRIP_M)], -1)  # straight across the middle of the table
HEADING = np.zeros(50)


@pytest.mark.parametrize(
    ("symbol", "y", "touches"),
    [
        ("glass", 0.7, False),  # beside a tall item
        ("glass", 0.55, True),
        ("cutlery", 0.5, False),  # over a flat one
        ("plate", 0.5, False),
        ("glass", 0.5, True),  # through a tall one
    ],
)
def test_a_part_touches_what_is_as_near_as_its_radius_and_as_tall_as_its_lower_edge(symbol, y: float, touches: bool):
    layouts = empty(1, 2)
    layouts.symbol[0, 0], layouts.centre[0, 0], layouts.radius[0, 0] = SYMBOLS.index(symbol), (0.5, y), 0.05
    touched, _ = simulate(layouts, 0, SIDE_M, HEIGHTS, MASSES, [SHAKER], GRIP, HEADING, 2.0)
    assert touched.tolist() == [touches, False]
