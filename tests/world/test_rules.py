"""The truth: clearances are exact, and its symmetries and orders hold whatever the scene."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from pipeline.world.bezier import P_F, P_INIT, random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts, random_layouts
from pipeline.world.rules import clear_cases, clearance, slack, valid
from tests.factories import ITEMS, MARGINS, RULES

seeds = st.integers(0, 2**32 - 1)


def some(seed: int, scenes: int = 3, paths: int = 20) -> tuple[Layouts, np.ndarray]:
    rng = np.random.default_rng(seed)
    return random_layouts(rng, scenes, ITEMS, np.arange(4), RULES), random_z_theta(rng, scenes, paths)


def moved(layouts: Layouts, centre: np.ndarray, angle: np.ndarray) -> Layouts:
    return Layouts(layouts.item, layouts.symbol, centre, angle, layouts.scale, layouts.half_length, layouts.radius)


@settings(max_examples=12, deadline=None)
@given(seeds)
def test_reflection_in_the_start_goal_diagonal_and_half_a_turn_leave_every_label_unchanged(seed):
    layouts, z = some(seed)
    mirrored = moved(layouts, layouts.centre[..., ::-1], np.pi / 2 - layouts.angle)
    turned = moved(layouts, P_INIT + P_F - layouts.centre, layouts.angle)
    for margins in MARGINS.values():
        before = slack(layouts, clearance(layouts, z), margins)
        for same, path in ((mirrored, z[..., ::-1]), (turned, P_INIT + P_F - z)):
            np.testing.assert_allclose(slack(same, clearance(same, path), margins), before, atol=1e-12)


@settings(max_examples=12, deadline=None)
@given(seeds, st.floats(0, 0.1), st.floats(0, 0.1))
def test_a_wider_margin_never_makes_a_path_valid(seed, a, b):
    """So whatever satisfies careful satisfies normal; aggressive forbids nothing."""
    layouts, z = some(seed)
    narrow, wide = (valid(layouts, z, dict.fromkeys(SYMBOLS, m)) for m in sorted((a, b)))
    careful, normal, aggressive = (valid(layouts, z, MARGINS[user]) for user in ("careful", "normal", "aggressive"))
    assert not (wide & ~narrow).any() and not (careful & ~normal).any() and aggressive.all()


def exact_clearance(z: np.ndarray, centre: np.ndarray, radius: float) -> float:
    """Distance from a quadratic Bezier curve to a disc: the roots of the cubic where it is stationary."""
    a, b = P_INIT - 2 * z + P_F, 2 * (z - P_INIT)
    curve = [Polynomial([P_INIT[k] - centre[k], b[k], a[k]]) for k in range(2)]
    squared = curve[0] ** 2 + curve[1] ** 2
    roots = squared.deriv().roots()
    t = np.concatenate([[0.0, 1.0], np.clip(roots[np.abs(roots.imag) < 1e-9].real, 0, 1)])
    return float(np.sqrt(np.maximum(squared(t), 0)).min()) - radius


@settings(max_examples=12, deadline=None)
@given(seeds)
def test_clearance_from_a_disc_is_the_exact_one_within_a_fifth_of_a_millimetre(seed):
    layouts, z = some(seed, scenes=2, paths=6)
    measured = clearance(layouts, z)
    for scene, slot in zip(*np.nonzero(layouts.present & (layouts.half_length == 0)), strict=True):
        for path in range(z.shape[1]):
            exact = exact_clearance(z[scene, path], layouts.centre[scene, slot], float(layouts.radius[scene, slot]))
            assert abs(measured[scene, path, slot] - exact) < 2e-4 or exact < -0.9 * layouts.radius[scene, slot]


def test_clearance_from_a_capsule_agrees_with_a_dense_cloud_of_its_points():
    layouts, z = some(3, scenes=12, paths=8)
    gaps_measured = clearance(layouts, z)
    t = np.linspace(0, 1, 1001)[:, None]
    path = (1 - t) ** 2 * P_INIT + 2 * t * (1 - t) * z[:, :, None] + t**2 * P_F
    for scene, slot in zip(*np.nonzero(layouts.half_length > 0), strict=True):
        a, b = layouts.ends[scene, slot]
        axis = a + np.linspace(0, 1, 101)[:, None] * (b - a)
        gaps = np.linalg.norm(path[scene][:, :, None] - axis, axis=-1).min((1, 2)) - layouts.radius[scene, slot]
        measured = gaps_measured[scene, :, slot]
        outside = gaps > 0.005
        np.testing.assert_allclose(measured[outside], gaps[outside], atol=3e-4)


@given(seed=st.integers(0, 1000), clear_m=st.sampled_from([0.0, 0.05, 0.1]), shift=st.sampled_from([-0.3, 0.0, 0.05]))
@settings(max_examples=40, deadline=None)
def test_cases_are_different_and_clear_and_others_fill_in_only_where_a_scene_has_too_few(seed, clear_m, shift):
    rng = np.random.default_rng(seed)
    slacks = rng.uniform(-0.15, 0.15, 200) + shift
    chosen = clear_cases(rng, slacks, clear_m, 20)
    assert len(set(chosen.tolist())) == 20
    clear = (slacks > clear_m) | (slacks <= -clear_m)
    if clear.sum() >= 20:
        assert clear[chosen].all()
    else:
        assert set(np.flatnonzero(clear)) <= set(chosen.tolist())
