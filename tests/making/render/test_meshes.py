"""Meshes fill their footprints, and the gap of one that does not is measured."""

import numpy as np
import pytest

from making.render.meshes import into_capsule, outline_gap, swept, turned

PROFILE = np.array([[0.0, 0.0], [0.03, 0.0], [0.06, 0.04], [0.055, 0.04], [0.0, 0.005]])


@pytest.mark.parametrize("half_length", [0.0, 0.03])
def test_a_turned_profile_fills_its_footprint(half_length):
    mesh = turned(PROFILE, 0.07, half_length)
    assert outline_gap([mesh], 0.07, half_length, filled=True) < 1e-4
    assert outline_gap([mesh], 0.0714, half_length, filled=True) == pytest.approx(0.0014, abs=1e-4)


def test_a_rod_moved_into_its_capsule_touches_ends_and_sides():
    x = np.linspace(-0.1, 0.1, 41)
    mesh = swept(np.stack([x, 0 * x, 0 * x], -1), np.full_like(x, 0.012), np.full_like(x, 0.001))
    assert outline_gap([into_capsule(mesh, 0.012, 0.088)], 0.012, 0.088, filled=False) < 5e-4
    assert outline_gap([mesh], 0.012, 0.088, filled=False) > 0.004  # its corners
