"""The search maximises log P(valid) less the cost of distance, of a model and of the truth."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.planning import bumps
from pipeline.planning.nearest import by_model, constant_detour, nearest, nearest_valid
from pipeline.world.bezier import Z_HIGH, Z_LOW, lattice, random_z_theta
from pipeline.world.layout import SYMBOLS, random_layouts
from pipeline.world.rules import valid
from tests.factories import ITEMS, RULES
from tests.planning.hills import Hill

STARTS = random_z_theta(np.random.default_rng(0), 3, 5).reshape(-1, 2)
SCENES = np.repeat(np.arange(3), 5)
SIDE = 28
RESOLUTION = (Z_HIGH - Z_LOW) / SIDE / 4**2
CAREFUL = dict.fromkeys(SYMBOLS, 0.045)
LAYOUTS = random_layouts(np.random.default_rng(0), 6, ITEMS, np.arange(4), RULES)


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
    log_valid = by_model(Hill(), np.zeros((3, 100, 100, 3), dtype=np.uint8))
    ends, log_p = nearest(log_valid, SCENES, STARTS, 0.3, SIDE, 2)
    np.testing.assert_allclose(log_p, log_valid(0, ends), atol=1e-6)
    distance = np.linalg.norm(lattice(SIDE) - STARTS[:, None], axis=-1)
    best = (log_valid(0, lattice(SIDE)) - 0.3 * distance).max(1)
    assert (log_p - 0.3 * np.linalg.norm(ends - STARTS, axis=-1) >= best - 1e-6).all()


@pytest.mark.parametrize("margins", [CAREFUL, dict.fromkeys(SYMBOLS) | {"glass": 0.038}])
def test_the_oracle_s_ends_are_valid_and_no_point_of_the_lattice_is_nearer(margins):
    starts = random_z_theta(np.random.default_rng(1), 6, 8)
    ends = nearest_valid(LAYOUTS, starts, margins, SIDE, 2)
    assert valid(LAYOUTS, ends, margins).all()
    points = np.broadcast_to(lattice(SIDE), (6, SIDE * SIDE, 2))
    distance = np.linalg.norm(points[:, None] - starts[:, :, None], axis=-1)  # (scene, start, point)
    distance[~np.broadcast_to(valid(LAYOUTS, points, margins)[:, None], distance.shape)] = np.inf
    assert (np.linalg.norm(ends - starts, axis=-1) <= distance.min(-1) + 1e-12).all()


def test_the_constant_detour_is_valid_in_as_many_scenes_as_any_other():
    z = constant_detour(LAYOUTS, CAREFUL, SIDE)
    share = valid(LAYOUTS, np.broadcast_to(lattice(SIDE), (6, SIDE * SIDE, 2)), CAREFUL).mean(0)
    assert valid(LAYOUTS, np.broadcast_to(z, (6, 1, 2)), CAREFUL).mean() == share.max()


def test_free_ends_leave_a_place_where_no_curve_may_end_by_about_the_least_way():
    line = np.stack([np.linspace(0.1, 0.9, bumps.POINTS), np.full(bumps.POINTS, 0.5)], -1)

    def ends_left_of_80_cm(scene, points):
        return np.where(points[..., -1, 0] < 0.8, 0.0, -np.inf)

    _, log_p = bumps.nearest(ends_left_of_80_cm, 0, line, 1.0)
    offsets, free_log_p = bumps.nearest(ends_left_of_80_cm, 0, line, 1.0, free_ends=True)
    ends = line + bumps.basis(free_ends=True) @ offsets
    assert log_p == -np.inf and free_log_p == 0
    assert 0.7 < ends[-1, 0] < 0.8 and bumps.displacement(offsets) < 0.1
