"""Clearances in three dimensions agree with plane geometry, and with physics."""

import numpy as np
import pytest

from pipeline.robot.arm import Arm
from pipeline.robot.carried import Part, clearances, gripper_of
from pipeline.robot.physics import Solid, simulate
from pipeline.world.layout import Layouts, empty
from pipeline.world.symbols import SYMBOLS

SIDE_M, GRIP_M = 0.6, 0.155
HEIGHTS = {"bowl": 0.06, "plate": 0.02, "cutlery": 0.01, "glass": 0.12}
SHAKER = Part(0.0, 0.0, 0.02, 0.14, 0.02)  # its lower edge is 1.5 cm above the table
SOLIDS = {symbol: Solid(height, 0.2) for symbol, height in HEIGHTS.items()}


def one_item(symbol: str, x: float, y: float, radius: float = 0.05, half_length: float = 0.0) -> Layouts:
    layouts = empty(1, 2)
    layouts.symbol[0, 0], layouts.centre[0, 0], layouts.radius[0, 0] = SYMBOLS.index(symbol), (x, y), radius
    layouts.half_length[0, 0] = half_length
    return layouts


def along_x(y: float) -> tuple[np.ndarray, np.ndarray]:
    """A movement across the table at y [table sides]: grip (1, instant, 3) [m] and heading."""
    x = np.linspace(0.1, 0.9, 50) * SIDE_M
    return np.stack([x, np.full(50, SIDE_M * y), np.full(50, GRIP_M)], -1)[None], np.zeros((1, 50))


@pytest.mark.parametrize(
    ("symbol", "y", "expected"),
    [
        ("glass", 0.7, 0.6 * 0.15 - 0.02),  # beside a tall item: the distance in the plane
        ("cutlery", 0.5, 0.015 - 0.6 * 0.01),  # over a flat one: the height above it
        ("glass", 0.5, -0.6 * 0.05 - 0.02),  # through a tall one: negative
    ],
)
def test_a_clearance_is_the_distance_in_the_plane_or_above_the_item(symbol: str, y: float, expected: float):
    least = clearances(SHAKER, *along_x(0.5), one_item(symbol, 0.5, y), SIDE_M, HEIGHTS)
    assert least[0, 0] == pytest.approx(expected, abs=6e-3)
    assert np.isinf(least[0, 1])


def test_the_gripper_passes_over_every_item_and_surrounds_the_grip(pr2: Arm):
    gripper = gripper_of(pr2)
    assert gripper.back_m < 0 and 0.02 < gripper.radius_m < 0.1
    assert GRIP_M - gripper.bottom_m > SIDE_M * max(HEIGHTS.values())


@pytest.mark.parametrize(
    ("symbol", "y"), [("glass", 0.5), ("glass", 0.62), ("glass", 0.7), ("plate", 0.5), ("bowl", 0.5)]
)
def test_physics_touches_what_has_no_clearance(symbol: str, y: float):
    layouts, (grip, heading) = one_item(symbol, 0.5, y), along_x(0.5)
    least = clearances(SHAKER, grip, heading, layouts, SIDE_M, HEIGHTS)[0, 0]
    outcome = simulate(layouts, 0, SIDE_M, SOLIDS, [SHAKER], grip[0], heading[0], 2.0, 0.5)
    assert outcome.touched[0] == (least < 0)
    assert (outcome.moved_m[0] > 0.005) == (least < -0.005)


def test_a_tall_thin_item_falls_and_a_long_one_is_pushed():
    grip, heading = along_x(0.5)
    thin = {**SOLIDS, "glass": Solid(0.3, 0.05)}
    outcome = simulate(
        one_item("glass", 0.5, 0.5, 0.015),
        0,
        SIDE_M,
        thin,
        [Part(0.0, 0.0, 0.02, 0.0, 0.02)],
        grip[0],
        heading[0],
        2.0,
        0.5,
    )
    assert outcome.fallen[0] and not outcome.fallen[1]
    outcome = simulate(
        one_item("bowl", 0.5, 0.5, 0.03, 0.05), 0, SIDE_M, SOLIDS, [SHAKER], grip[0], heading[0], 2.0, 0.5
    )
    assert outcome.moved_m[0] > 0.1
