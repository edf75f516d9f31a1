"""Objects are detected where they were drawn."""

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.models.base import to_tensor
from pipeline.perception.capsule import fit_capsule
from pipeline.perception.objects import MAX_OBJECTS, SIDE, SUPERSAMPLING, detect_objects
from tests.factories import RED, WHITE, draw_table, to_pixels

DISCS = (0.3, 0.7, 0.08, RED), (0.75, 0.4, 0.045, WHITE)


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


@pytest.mark.parametrize("noise", [0.0, 0.05])
@pytest.mark.parametrize("wide", [2, 3, 4])  # pixels
def test_an_ordered_pattern_is_an_object_and_its_shuffled_pixels_are_none(wide: int, noise: float):
    """A disc of rings, red and white in turn."""
    rng = np.random.default_rng(wide)
    image = draw_table().astype(float) / 255
    away = np.hypot(*(np.mgrid[:SIDE, :SIDE] - 50.0))
    disc = away < 8
    image[disc] = np.where((away // wide % 2 == 0)[..., None], RED, WHITE)[disc]
    shuffled = image.copy()
    shuffled[disc] = rng.permutation(image[disc])
    seen = (to_pixels(x + noise * rng.standard_normal(x.shape)) for x in (image, shuffled))
    assert [int(detect_objects(to_tensor(x[None])).present.sum()) for x in seen] == [1, 0]


@pytest.mark.parametrize("noise", [0.02, 0.1])
def test_an_object_of_one_colour_is_one_however_noisy(noise: float):
    image = draw_table((0.5, 0.5, 0.08, RED), grain=0.0) / 255
    noisy = to_pixels(image + noise * np.random.default_rng(0).standard_normal(image.shape))
    assert detect_objects(to_tensor(noisy[None])).present.sum() == 1


def test_discs_are_detected_where_they_are_largest_first():
    objects = detect_objects(to_tensor(draw_table(*DISCS)[None]))
    assert objects.present[0].sum() == 2
    for i, (x, y, radius, _) in enumerate(DISCS):
        assert objects.ends[0, i].mean(0) == pytest.approx((x, y), abs=3e-3)
        assert radius < objects.radius[0, i] < radius + 0.01  # smoothing moves outlines out by less than a pixel


@pytest.mark.parametrize("seed", range(5))
def test_no_object_is_detected_on_an_empty_table(seed):
    assert not detect_objects(to_tensor(draw_table(seed=seed)[None])).present.any()


def mottled(seed: int) -> np.ndarray:
    """A table with blotches a few pixels wide, of standard deviation .04 [1 = white], under little grain."""
    rng = np.random.default_rng(seed)
    blotches = cv2.GaussianBlur(rng.standard_normal((SIDE, SIDE)), (33, 33), 4, borderType=cv2.BORDER_REFLECT)
    return 0.5 + 0.04 * (blotches / blotches.std())[..., None] + 0.01 * rng.standard_normal((SIDE, SIDE, 3))


@pytest.mark.parametrize("seed", range(5))
def test_a_thin_rim_is_the_only_object_on_a_mottled_table(seed):
    image, (x, y, radius) = mottled(seed), (0.55, 0.4, 0.05)
    assert not detect_objects(to_tensor(to_pixels(image)[None])).present.any()
    row, column = np.mgrid[:SIDE, :SIDE] + 0.5
    from_rim = np.abs(np.hypot(column - SIDE * x, SIDE * (1 - y) - row) - SIDE * radius)
    ring = 0.12 * (from_rim < 0.75)[..., None]  # three standard deviations of the blotches
    objects = detect_objects(to_tensor(to_pixels(image + ring)[None]))
    assert objects.present[0].sum() == 1
    assert objects.ends[0, 0].mean(0) == pytest.approx((x, y), abs=5e-3)
    assert objects.radius[0, 0] == pytest.approx(radius + 0.0075, abs=8e-3)


@pytest.mark.parametrize("seed", range(5))
def test_a_line_no_bolder_than_the_table_is_its_grain(seed):
    """The same line on a plain table is an object."""
    row, column = np.mgrid[:SIDE, :SIDE] + 0.5
    line = 0.1 * ((np.abs(row - SIDE / 2) < 1) & (column > 10) & (column < 70))[..., None]
    tables = mottled(seed), draw_table(seed=seed) / 255
    objects = detect_objects(to_tensor(np.stack([to_pixels(table + line) for table in tables])))
    assert objects.present.sum(1).tolist() == [0, 1]


def test_a_broken_rim_is_one_round_object():
    """Two thirds of a rim that does not close."""
    image, (x, y, radius) = mottled(0), (0.55, 0.4, 0.05)
    row, column = np.mgrid[:SIDE, :SIDE] + 0.5
    right, up = column - SIDE * x, SIDE * (1 - y) - row
    rim = (np.abs(np.hypot(right, up) - SIDE * radius) < 0.75) & (np.abs(np.arctan2(up, right)) < 2 * np.pi / 3)
    objects = detect_objects(to_tensor(to_pixels(image + 0.16 * rim[..., None])[None]))
    assert objects.present[0].sum() == 1
    assert np.ptp(objects.ends[0, 0], axis=0).max() < radius
    assert objects.ends[0, 0].mean(0) == pytest.approx((x + radius / 4, y), abs=0.012)


@pytest.mark.parametrize(
    ("marks", "faint", "count"),
    [(3, True, 1), (2, True, 3), (3, False, 4)],
    ids=["three faint ones are the table's", "two may be objects", "three bold ones are objects"],
)
@pytest.mark.parametrize("kind", ["specks", "veins"])
def test_faint_marks_are_the_table_s_pattern_if_there_are_several(kind: str, marks: int, faint: bool, count: int):
    """Veins are right angles: larger than a speck, and unlike any capsule."""
    places, grey = ((0.2, 0.2), (0.8, 0.3), (0.5, 0.85))[:marks], 0.535 if faint else 0.56
    image = draw_table(DISCS[0], *((x, y, 0.022, (grey,) * 3) for x, y in places if kind == "specks"))
    for row, column in ((15, 60), (60, 65), (68, 10))[: marks if kind == "veins" else 0]:
        for part in (np.s_[row : row + 4, column : column + 24], np.s_[row : row + 24, column : column + 4]):
            image[part] = image[part] + np.uint8(7 if faint else 40)
    objects = detect_objects(to_tensor(image[None]))
    assert objects.present[0].sum() == count
    assert objects.ends[0, 0].mean(0) == pytest.approx(DISCS[0][:2], abs=3e-3)


@pytest.mark.parametrize("grey", [0.53, 0.535])
def test_a_larger_disc_stays_beside_specks_as_faint_as_itself(grey):
    """A pale plate on a speckled table: a pattern does not make a plate less of a danger."""
    discs = [
        (x, y, radius, (grey,) * 3) for x, y, radius in ((0.5, 0.5, 0.07), *((x, 0.15, 0.022) for x in (0.2, 0.5, 0.8)))
    ]
    objects = detect_objects(to_tensor(draw_table(*discs)[None]))
    assert objects.present[0].sum() == 1
    assert objects.ends[0, 0].mean(0) == pytest.approx((0.5, 0.5), abs=3e-3)


@pytest.mark.parametrize("gap", [0.005, 0.01, 0.02])
def test_discs_that_all_but_touch_are_two_objects(gap):
    radii = 0.045, 0.07
    left = 0.35
    right = left + sum(radii) + gap
    objects = detect_objects(to_tensor(draw_table((left, 0.5, radii[0], WHITE), (right, 0.5, radii[1], RED))[None]))
    assert objects.present[0].sum() == 2
    assert objects.ends[0, 0].mean(0) == pytest.approx((right, 0.5), abs=6e-3)
    assert objects.ends[0, 1].mean(0) == pytest.approx((left, 0.5), abs=6e-3)


def test_a_disc_with_a_thin_handle_is_one_object():
    x, y, radius, _ = DISCS[0]
    image = draw_table(DISCS[0])
    row, column = round(SIDE * (1 - y)), round(SIDE * x)
    image[row - 1 : row + 2, column : column + 25] = (204, 51, 51)
    objects = detect_objects(to_tensor(image[None]))
    assert objects.present[0].sum() == 1
    assert np.ptp(objects.ends[0, 0, :, 0]) + 2 * objects.radius[0, 0] > 2.2 * radius  # the handle is part of it


def bar(image: np.ndarray, start: float, end: float, half_width: float, colour: tuple[float, ...]) -> np.ndarray:
    """Return the image with a bar of `colour` on it at y = .5, from x = `start` to `end` [m]."""
    row, column = np.mgrid[:SIDE, :SIDE] + 0.5
    inside = (np.abs(row - SIDE / 2) < SIDE * half_width) & (column > SIDE * start) & (column < SIDE * end)
    return np.where(inside[..., None], np.round(255 * np.array(colour)), image).astype(np.uint8)


def test_a_pale_handle_belongs_to_its_blade():
    pale = (0.6, 0.6, 0.6)
    knife = bar(bar(draw_table(grain=0.008), 0.4, 0.51, 0.01, WHITE), 0.5, 0.6, 0.01, pale)
    objects = detect_objects(to_tensor(knife[None]))
    assert objects.present[0].sum() == 1
    ends = np.sort(objects.ends[0, 0, :, 0]) + np.array([-1, 1]) * objects.radius[0, 0]
    assert ends == pytest.approx((0.4, 0.6), abs=0.02)


def test_a_faint_light_does_not_move_objects():
    lit = draw_table(*DISCS) * np.linspace(0.9, 1.0, SIDE)[None, :, None]
    objects = detect_objects(to_tensor(lit.astype(np.uint8)[None]))
    assert objects.present[0].sum() == 2
    assert objects.ends[0, 0].mean(0) == pytest.approx(DISCS[0][:2], abs=3e-3)


def test_an_image_on_its_side_has_its_objects_on_their_side():
    upright = draw_table(*DISCS)
    straight, turned = (detect_objects(to_tensor(np.ascontiguousarray(p)[None])) for p in (upright, np.rot90(upright)))
    x, y = straight.ends[0, :2].mean(1).T
    np.testing.assert_allclose(turned.ends[0, :2].mean(1), np.stack([1 - y, x], 1), atol=2e-3)
    np.testing.assert_allclose(turned.radius[0], straight.radius[0], atol=2e-3)


def test_an_image_does_not_see_its_neighbours_and_may_need_gradients():
    images = np.stack([draw_table(*DISCS), draw_table(DISCS[0], seed=1), draw_table(seed=2)])
    together, alone = detect_objects(to_tensor(images).requires_grad_()), detect_objects(to_tensor(images[1:2]))
    for name in ("ends", "radius", "features", "present"):
        np.testing.assert_array_equal(getattr(together, name)[1:2], getattr(alone, name))
    assert together.present.shape == (3, MAX_OBJECTS) and torch.is_grad_enabled()
