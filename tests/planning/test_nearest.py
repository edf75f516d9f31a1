"""The search maximises log P(valid) less the cost of distance, of a model and of the truth."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.planning.nearest import by_model, nearest
from pipeline.world.bezier import Z_HIGH, Z_LOW, lattice, random_z_theta
from tests.planning.hills import Hill

IMAGES = np.zeros((3, 100, 100, 3), dtype=np.uint8)
STARTS = random_z_theta(np.random.default_rng(0), 3, 5).reshape(-1, 2)
SCENES = np.repeat(np.arange(3), 5)
SIDE = 28
RESOLUTION = (Z_HIGH - Z_LOW) / SIDE / 4**2


def disc(radius: float):
    """A rule: valid within `radius` [m] of the middle of the square."""
    return lambda scene, z: np.where(np.linalg.norm(z - 0.5, axis=-1) < radius, 0.0, -np.inf)


@settings(max_examples=20, deadline=None)
@given(radius=st.floats(0.1, 0.6), penalty=st.floats(0.1, 10))
def test_a_certain_rule_gives_the_nearest_valid_path_at_any_penalty(radius: float, penalty: float):
    ends, log_p = nearest(disc(radius), SCENES, STARTS, penalty, SIDE, 2)
    assert (log_p == 0).all() and (np.linalg.norm(ends - 0.5, axis=-1) < radius).all()
    least = (np.linalg.norm(STARTS - 0.5, axis=-1) - radius).clip(0)
    longer = np.linalg.norm(ends - STARTS, axis=-1) - least
    assert longer.min() > -1e-9 and longer.max() < 2 * RESOLUTION


def test_a_model_s_end_is_better_than_every_point_of_the_lattice():
    log_valid = by_model(Hill(), IMAGES)
    ends, log_p = nearest(log_valid, SCENES, STARTS, 0.3, SIDE, 2)
    np.testing.assert_allclose(log_p, log_valid(0, ends), atol=1e-6)
    distance = np.linalg.norm(lattice(SIDE) - STARTS[:, None], axis=-1)
    best = (log_valid(0, lattice(SIDE)) - 0.3 * distance).max(1)
    assert (log_p - 0.3 * np.linalg.norm(ends - STARTS, axis=-1) >= best - 1e-6).all()
