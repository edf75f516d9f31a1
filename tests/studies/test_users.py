"""Who is named, clusters, routes and verdicts on cases whose answer is known."""

import numpy as np
import pytest

from pipeline.world.layout import empty
from studies.users.stage import best_accuracy, gap, judge, left_of_items, measures, routes


def test_users_far_apart_are_named_and_users_alike_are_not():
    rng, user = np.random.default_rng(0), np.tile([0, 1, 2], 60)
    scene = np.repeat(np.arange(18), 10)
    noise = rng.normal(0, 0.05, (180, 2))
    apart = measures(noise + user[:, None], scene, user, 5, rng, 19)
    assert apart[0, 0] == 1 and apart[0, 1] > 0.8
    assert (apart[1:, 1] < 0).all() and (apart[1:, 0] < 0.6).all()  # shuffled within scenes
    alike = measures(noise, scene, user, 5, rng, 199)[:, 0]
    assert alike[0] == pytest.approx(1 / 3, abs=0.12) and alike.mean() == pytest.approx(1 / 3, abs=0.02)


def test_the_gap_is_large_if_one_dimension_alone_tells_a_fact_and_none_if_two_do():
    codes = np.random.default_rng(0).normal(size=(2000, 3))
    fact = (codes[:, 1] > 0).astype(int)
    assert gap(codes, fact) > 0.95
    assert gap(codes[:, [0, 1, 1]], fact) == 0


def test_a_perfect_clusterer_is_right_where_valid_sets_differ():
    nested = np.array([[1, 0, 0, 0], [1, 1, 0, 0], [1, 1, 1, 1]], float)  # best: 1 + 1/2 + 2/4, over three users
    assert best_accuracy(nested) == pytest.approx(2 / 3)
    assert best_accuracy(np.eye(3)) == 1 and best_accuracy(np.ones((3, 7))) == pytest.approx(1 / 3)
    with_a_closed_table = np.stack([nested, np.zeros_like(nested)], axis=1)
    assert best_accuracy(with_a_closed_table) == pytest.approx(2 / 3)


def test_a_path_has_an_item_on_the_side_away_from_its_control_point():
    layouts = empty(1, 2)  # a glass on the straight line between the ends
    layouts.symbol[0, 0], layouts.item[0, 0], layouts.centre[0, 0] = 3, 0, (0.5, 0.49)
    z = np.array([[[0.2, 1.0], [1.0, 0.2], [0.5, 0.5], [0.0, 0.02]]])  # above, below, straight, hardly bent
    margins = dict.fromkeys(("bowl", "plate", "cutlery"), None) | {"glass": 0.04}
    sides = left_of_items(layouts, z, margins)
    assert sides[0, :, 0].tolist() == [False, True, False, False] and not sides[..., 1].any()
    assert not left_of_items(layouts, z, dict.fromkeys(margins)).any()  # nothing to avoid, one route
    assert [routes(sides, np.full((1, 4), chosen)).tolist() for chosen in (True, False)] == [[2], [0]]


def test_a_verdict_needs_the_whole_interval_and_a_failure_a_bar_that_can_be_passed():
    cases = {(0.1, 0.2, False): "holds", (-0.1, 0.2, True): "open", (-0.2, -0.1, True): "fails"}
    cases |= {(-0.2, -0.1, False): "open"}
    assert [judge(0, *case) for case in cases] == list(cases.values())
