"""Capsules are fitted where the points are."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.perception.objects import SUPERSAMPLING, fit_capsule
from pipeline.world.layout import SIDE


@given(
    st.floats(0.02, 0.08), st.floats(0.0, 0.1), st.floats(-1.5, 1.5), st.floats(0.3, 0.7), st.floats(0.3, 0.7)
)  # radius, half-length [m], angle [rad], centre [m]
@settings(max_examples=50, deadline=None)
def test_a_capsule_is_recovered_from_its_points(radius, half_length, angle, x, y):
    fine = SUPERSAMPLING * SIDE
    grid = (np.mgrid[:fine, :fine].reshape(2, -1).T[:, ::-1] + 0.5) / fine
    along = np.array([np.cos(angle), np.sin(angle)])
    offset = grid - (x, y)
    share = np.clip(offset @ along, -half_length, half_length)
    points = grid[np.linalg.norm(offset - share[:, None] * along, axis=1) < radius]
    centre, half, fitted_radius, area, elongation = fit_capsule(points, fine)
    # Each point stands for a square of side 1 / fine: the squares cover the capsule made smaller by half their diagonal
    # and are covered by the one made larger by it.
    half_diagonal = np.sqrt(0.5) / fine
    assert np.linalg.norm(centre - (x, y)) < half_diagonal
    assert fitted_radius == pytest.approx(radius, abs=half_diagonal)
    if half_length < radius / 2:  # which way a nearly round object points is anyone's guess
        assert np.linalg.norm(half) < half_length + 5e-3
    else:
        assert abs(half @ along) == pytest.approx(half_length, abs=5e-3)
    smaller, larger = radius - half_diagonal, radius + half_diagonal
    assert np.pi * smaller**2 + 4 * half_length * smaller < area < np.pi * larger**2 + 4 * half_length * larger
    assert elongation >= 1
