"""A picture like the others is called strange no more often than promised; one that is plainly unlike them is."""

import numpy as np
import pytest
from numpy import ndarray as Array

from pipeline.spec.strangeness import Looks, oddness, strange
from pipeline.table.disturbances import blur, noise
from pipeline.table.layout import random_layouts
from pipeline.table.render import read_palette, render_scenes
from tests.examples import RULES


@pytest.fixture(scope="module")
def scenes() -> Array:
    """60 scenes of training items on training tops."""
    catalogue, palette = read_palette("data")
    rng = np.random.default_rng(0)
    layouts = random_layouts(rng, 60, catalogue.footprints, catalogue.pool("train"), RULES)
    tops = rng.choice(catalogue.texture_names("train"), 60)
    return render_scenes(layouts, list(tops), rng.integers(2**31, size=60).tolist(), palette)


def random_looks(rng: np.random.Generator, pictures: int, shift: float = 0.0) -> Looks:
    """Spreads and things that come alike, but for a `shift` of the spreads."""
    things = [rng.normal(size=(rng.integers(5), 6)).astype(np.float32) for _ in range(pictures)]
    return Looks(rng.normal(size=(pictures, 3)) + shift, things)


def test_of_pictures_that_come_alike_at_most_one_in_their_number_and_one_is_strange():
    rng = np.random.default_rng(0)
    called = [strange(random_looks(rng, 20), random_looks(rng, 1))[0] for _ in range(1500)]
    share = 1 / 21
    assert abs(np.mean(called) - share) < 4 * np.sqrt(share * (1 - share) / 1500)


def test_the_order_of_pictures_does_not_matter():
    rng = np.random.default_rng(1)
    looks, order = random_looks(rng, 12), rng.permutation(12)
    shuffled = Looks(looks.spread[order], [looks.things[i] for i in order])
    np.testing.assert_allclose(oddness(shuffled), oddness(looks)[order])


def test_another_table_is_strange_whatever_lies_on_it():
    rng = np.random.default_rng(2)
    assert strange(random_looks(rng, 20), random_looks(rng, 30, shift=20.0)).all()


def test_things_like_no_other_are_strange_though_the_table_is_not():
    rng = np.random.default_rng(3)
    own = random_looks(rng, 20)
    other = Looks(own.spread[:1] + 1e-3, [np.full((1, 6), 30, np.float32)])
    assert strange(own, other).all()


def test_among_pictures_that_are_all_alike_any_other_is_strange_and_one_more_of_them_is_not():
    looks = random_looks(np.random.default_rng(5), 1)
    alike = Looks(np.repeat(looks.spread, 20, axis=0), looks.things * 20)
    other = Looks(looks.spread + 1e-3, looks.things)
    with np.errstate(all="raise"):
        assert strange(alike, other).all() and not strange(alike, looks).any()


@pytest.mark.parametrize("things", [0, 2])
def test_pictures_without_a_thing_are_compared_by_their_tables(things: int):
    rng = np.random.default_rng(4)
    bare = Looks(rng.normal(size=(20, 3)), [np.zeros((0, 6), np.float32)] * 20)
    other = Looks(bare.spread[:1], [rng.normal(size=(things, 6)).astype(np.float32)])
    assert np.isfinite(oddness(bare)).all()
    assert strange(bare, other).all() == (things > 0)


def test_a_camera_worse_than_in_training_is_noticed(scenes: Array):
    rng = np.random.default_rng(5)
    own, here = Looks.of(scenes[:20]), scenes[20:]
    assert strange(own, Looks.of(here)).mean() < 0.3
    assert strange(own, Looks.of(blur(rng, here, 4.0))).all()
    assert strange(own, Looks.of(noise(rng, here, 0.1))).all()
