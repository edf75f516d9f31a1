"""Study assumptions: percepts are spoilt as said, and association says what intervention does not."""

import numpy as np
import pandas as pd
import pytest
import statsmodels.api as sm
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.random import default_rng as rng

from pipeline.perception.objects import Objects
from pipeline.world.layout import Layouts, concatenated, segment_distance
from studies.assumptions.origin import inside, true_objects
from studies.assumptions.stage import NO_SUCH_KIND_M, added_gap, layout_distance, ledger, miss, mistake
from studies.assumptions.world import GLASS, PLATE, World, association, association_strength, lay_out
from tests.factories import ROUND_AND_OVAL, RULES, assert_clear

ROUND, OVAL = np.arange(4), np.arange(4, 8)
WORLD = World(
    root_seed=0, p_common_cause=0.9, doses=[0, 0.9], gap_m=[0.015, 0.04], present=0.8, glasses=2, near_m=0.045
)


def drawn(seed: int, scenes: int, pool: np.ndarray, p: float = 0.9) -> Layouts:
    return concatenated([lay_out(each, ROUND_AND_OVAL, pool, RULES, WORLD, p) for each in rng(seed).spawn(scenes)])


@pytest.mark.slow
@pytest.mark.parametrize("pool", [ROUND, OVAL])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=4, deadline=None)
def test_footprints_in_the_confounded_world_keep_the_clearances(pool, seed):
    layouts = drawn(seed, 4, pool)
    assert_clear(layouts, items=1e-5, ends=0.0)
    centre = layouts.centre[layouts.present]
    assert ((centre >= RULES.centre_low) & (centre <= RULES.centre_high)).all()
    assert set(layouts.item[layouts.present]) <= set(pool)


@pytest.mark.parametrize("pool", [ROUND, OVAL])
def test_with_a_common_cause_every_glass_stands_beside_a_plate(pool):
    layouts, (low, high) = drawn(1, 30, pool, p=1.0), WORLD.gap_m
    for scene in range(len(layouts)):
        plates, glasses = (np.flatnonzero(layouts.symbol[scene] == s) for s in (PLATE, GLASS))
        assert (len(plates), len(glasses)) in ((0, 0), (1, WORLD.glasses))
        ends, radius = layouts.ends[scene], layouts.radius[scene]
        apart = segment_distance(ends[plates][:, None], ends[glasses]) - radius[plates][:, None] - radius[glasses]
        assert ((apart >= low - 1e-5) & (apart <= high + 1e-5)).all()


def test_the_interval_is_that_of_least_squares_with_errors_clustered_by_scene():
    scene, path = rng(11).normal(size=(200, 1)), rng(11).normal(size=(200, 9))
    near = rng(11).normal(size=(200, 9)) + scene > 0.5
    invalid = path + scene + near > 1
    row = association(invalid, near)
    fit = sm.OLS(invalid.ravel().astype(float), sm.add_constant(near.ravel().astype(float))).fit()
    robust = fit.get_robustcov_results("cluster", groups=np.repeat(np.arange(200), 9))
    assert row["difference"] == pytest.approx(fit.params[1], abs=1e-6)
    np.testing.assert_allclose([row["ci_low"], row["ci_high"]], robust.conf_int()[1], atol=0.003)


def test_a_common_cause_associates_what_has_no_effect():
    """Glass g makes a path invalid; plate p only comes with it: adjusted for g, p says nothing."""
    g, alone, bound, bad = rng(11).uniform(size=(4, 400, 9)) < np.array([0.4, 0.4, 0.9, 0.8])[:, None, None]
    p, invalid = np.where(bound, g, alone), g & bad
    assert association(invalid, p)["ci_low"] > 0.5
    adjusted = association(invalid[g].reshape(-1, 1), p[g].reshape(-1, 1))
    assert adjusted["ci_low"] < 0 < adjusted["ci_high"]


def test_the_e_value_is_the_published_one_and_the_true_common_cause_explains_its_association():
    """VanderWeele and Ding (2017): a risk ratio of 3.9 has the E-value 7.26."""
    near = np.arange(2000)[:, None] < 1000
    invalid = np.arange(2000)[:, None] % 1000 < np.where(near, 390, 100)
    assert association_strength(invalid, near, near)["e_value"] == pytest.approx(7.26, abs=0.005)
    g, alone, bound, bad = rng(11).uniform(size=(4, 400, 9)) < np.array([0.4, 0.4, 0.9, 0.8])[:, None, None]
    never, p = rng(12).uniform(size=(400, 9)) < 0.1, np.where(bound, g, alone)
    strength = association_strength((g & bad) | never, p, g)
    assert 1 < strength["risk_ratio"] <= strength["bias_factor"]


def test_what_is_told_of_an_item_is_its_true_capsule():
    layouts = drawn(1, 6, ROUND)
    for scene in range(len(layouts)):
        objects = true_objects(np.full((100, 100, 3), 120, np.uint8), layouts[[scene]])
        present = layouts.present[scene]
        centres = np.mean([one.ends for one in objects], axis=1)
        np.testing.assert_allclose(centres, layouts.centre[scene][present], atol=0.002)
        np.testing.assert_allclose([one.radius for one in objects], layouts.radius[scene][present], atol=0.003)


def test_a_layout_is_no_distance_from_itself_and_far_from_one_without_its_kind():
    layouts = drawn(2, 8, ROUND)
    assert (layout_distance(layouts, layouts) == 0).all()
    moved = layouts[[0]]
    moved.centre[:] += 0.03
    alone = layout_distance(moved, layouts[[0]])
    assert 0 < alone[0] <= 0.03 * np.sqrt(2) + 1e-9
    other = layouts[[0]]
    other.symbol[other.present] = (other.symbol[other.present] + 1) % 4
    kinds = set(layouts.symbol[0][layouts.present[0]])
    if kinds != {(kind + 1) % 4 for kind in kinds}:
        assert layout_distance(layouts[[0]], other)[0] == NO_SUCH_KIND_M


def told(layouts: Layouts) -> Objects:
    objects = [true_objects(np.full((100, 100, 3), 120, np.uint8), layouts[[i]]) for i in range(len(layouts))]
    return Objects.of(objects, [0.0] * len(objects))


def test_missed_items_leave_no_gap_and_the_others_stay_as_they_are():
    objects = told(drawn(3, 12, ROUND))
    fewer = miss(rng(0), objects, 0.4)
    count = fewer.present.sum(1)
    assert (fewer.present == (np.arange(fewer.present.shape[1]) < count[:, None])).all()
    assert 0 < count.sum() < objects.present.sum()
    for scene in range(len(objects)):
        kept, there = fewer.ends[scene, : count[scene]], objects.ends[scene, objects.present[scene]]
        assert all((there == one).all((1, 2)).any() for one in kept)
    assert (miss(rng(0), objects, 0.1).present.sum(1) >= count).all()


def test_mistaken_items_stand_where_they_stood_and_have_features_of_others():
    objects = told(drawn(3, 12, ROUND))
    mistaken, present = mistake(rng(0), objects, 0.4), objects.present
    np.testing.assert_array_equal(mistaken.ends, objects.ends)
    changed = (mistaken.features != objects.features).any(-1)
    assert 0 < changed.sum() <= 0.7 * present.sum() and not changed[~present].any()
    assert {tuple(x) for x in mistaken.features[present]} <= {tuple(x) for x in objects.features[present]}


def test_an_added_item_s_gap_is_that_of_the_last_item_to_its_nearest_neighbour():
    layouts = drawn(4, 10, ROUND)
    for scene, gap in enumerate(added_gap(layouts)):
        *others, last = np.flatnonzero(layouts.present[scene])
        ends, radius = layouts.ends[scene], layouts.radius[scene]
        gaps = segment_distance(ends[others], ends[[last]]) - radius[others] - radius[last]
        assert gap == (pytest.approx(gaps.min()) if others else np.inf)


def test_an_item_covers_its_own_area():
    layouts = drawn(1, 4, ROUND)
    area = np.pi * layouts.radius**2 + 4 * layouts.half_length * layouts.radius
    np.testing.assert_allclose(inside(layouts, 200).mean((2, 3)), area * layouts.present, atol=2e-3)


def test_a_verdict_flips_at_the_first_dose_in_order_at_which_it_is_no_longer_right():
    right = {"glass": [1, 1, 0, 1], "plate": [0, 1, 0, 0], "bowl": [1, 1, 1, 1]}
    keys = {"attempt": "gap", "variant": "clearance", "user": "normal"}
    rows = [
        keys | {"symbol": s, "dose": d, "right": bool(x)}
        for s in right
        for d, x in zip((9, 3, 2, 1), right[s], strict=True)
    ]
    table = ledger(pd.DataFrame(rows), "normal").set_index("claim")
    assert table["flips_at"].tolist() == [2, 2] and table["strongest"].tolist() == [1, 1]
    assert table.loc["all", ["asked", "right_weakest", "right_strongest"]].tolist() == [3, 2, 2]
    assert ledger(pd.DataFrame(rows[4:]).assign(symbol="glass", dose=range(8)), "normal")["flips_at"].isna().all()
