"""Blame is what the rules of the world say it is, models told the truth are never wrong, and moves are exact."""

import numpy as np
import pytest

from pipeline.causal.counterfactual import (
    NOBODY,
    Removals,
    Tables,
    away,
    blame,
    crossing,
    first,
    fits,
    keep,
    move_study,
    nulls,
    removals,
    slide,
    study,
    unlike,
)
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, Items, Layouts, empty, random_layouts
from pipeline.world.rules import clearance, slack, valid
from tests.examples import RULES

CAREFUL: dict[str, float | None] = {symbol: 0.045 for symbol in SYMBOLS}
NORMAL: dict[str, float | None] = {symbol: 0.045 if symbol == "glass" else None for symbol in SYMBOLS}
ITEMS = Items(np.arange(4), np.array([0.0, 0.0, 0.075, 0.0]), np.array([0.065, 0.075, 0.013, 0.045]))
SCENES, PATHS = 20, 40


@pytest.fixture(scope="module")
def layouts() -> Layouts:
    return random_layouts(np.random.default_rng(0), SCENES, ITEMS, np.arange(4), RULES)


@pytest.fixture(scope="module")
def z_theta() -> np.ndarray:
    return random_z_theta(np.random.default_rng(1), SCENES, PATHS)


@pytest.fixture(scope="module")
def tables(layouts: Layouts) -> Tables:
    return removals(layouts.present)


def told(layouts: Layouts, z_theta: np.ndarray, tables: Tables, margins: dict) -> Removals:
    left = keep(layouts[tables.scene], tables.kept)
    return tables.fold(valid(left, z_theta[tables.scene], margins).astype(float))


def of_seeds(answer: Removals, seeds: int) -> Removals:
    parts = (answer.whole, answer.empty, answer.without, answer.alone)
    return Removals(*(np.repeat(part[None], seeds, axis=0) for part in parts))


def test_every_table_is_asked_about_once(layouts: Layouts, tables: Tables):
    items = layouts.present.sum(1)
    assert len(tables.scene) == (2**items).sum()  # of two or three items, the questions are all the subsets
    rows = np.concatenate([tables.scene[:, None], tables.kept], axis=1)
    assert len(np.unique(rows, axis=0)) == len(rows)
    asked = tables.kept[tables.index]  # (scene, question, slot)
    np.testing.assert_array_equal(asked[:, 0], layouts.present)
    assert not asked[:, 1].any()
    for slot in range(layouts.present.shape[1]):
        np.testing.assert_array_equal(asked[:, 2 + slot].sum(1), items - layouts.present[:, slot])
        np.testing.assert_array_equal(asked[:, 2 + layouts.present.shape[1] + slot].sum(1), layouts.present[:, slot])


@pytest.mark.parametrize("margins", [CAREFUL, NORMAL])
def test_in_truth_an_item_is_enough_if_the_path_comes_too_near_it_and_necessary_if_it_is_the_only_one(
    layouts: Layouts, z_theta: np.ndarray, tables: Tables, margins: dict
):
    truth = told(layouts, z_theta, tables, margins)
    margin = np.array([np.nan if margins[s] is None else margins[s] for s in SYMBOLS] + [np.nan])
    near = layouts.present[:, None] & (clearance(layouts, z_theta) <= margin[layouts.symbol][:, None])
    invalid, alone = near.any(-1), near.sum(-1) == 1
    np.testing.assert_array_equal(truth.whole == 0, invalid)
    np.testing.assert_array_equal(truth.sufficiency, near.astype(float))
    np.testing.assert_array_equal(truth.necessity[invalid], (near & alone[..., None])[invalid].astype(float))
    np.testing.assert_array_equal(blame(truth.necessity), np.where(alone, near.argmax(-1), NOBODY))
    assert (alone & invalid).any() and (~alone & invalid).any()


@pytest.mark.parametrize(
    ("necessity", "slot"),
    [([0.1, 0.3, 0.0], 1), ([0.0, 0.0, 0.0], NOBODY), ([0.3, 0.3, 0.1], NOBODY), ([np.nan] * 3, NOBODY)],
)
def test_the_blame_is_on_the_largest_necessity_and_on_nobody_if_it_is_shared(necessity: list, slot: int):
    assert blame(np.array(necessity)) == slot


@pytest.mark.parametrize("margins", [CAREFUL, NORMAL])
def test_models_told_the_truth_are_never_wrong(layouts: Layouts, z_theta: np.ndarray, tables: Tables, margins: dict):
    truth = told(layouts, z_theta, tables, margins)
    chances = nulls(blame(truth.necessity), layouts.present, layouts.symbol, clearance(layouts, z_theta))
    cell = study(of_seeds(truth, 3), truth, layouts.present, chances)
    assert cell is not None
    for name in ("blame_right", "blame_sure", "several_right", "ci_low", "ci_high", "recall"):
        assert cell[name] == 1, name
    for name in ("pn_error", "ps_error", "empty_rejected"):
        assert cell[name] == 0, name
    assert cell["rejected"] == (truth.whole == 0).sum()
    assert 1 / 3 <= cell["random_path"] <= cell["null_base_rate"] < 1
    assert cell["over_random"] == pytest.approx(1 - cell["random_path"], abs=1e-6)


def test_who_keeps_the_same_margin_from_all_blames_the_nearest(layouts: Layouts, z_theta: np.ndarray, tables: Tables):
    near = clearance(layouts, z_theta)
    for margins, always in ((CAREFUL, True), (NORMAL, False)):
        culprit = blame(told(layouts, z_theta, tables, margins).necessity)
        right = nulls(culprit, layouts.present, layouts.symbol, near)["nearest"][culprit != NOBODY]
        assert right.all() == always


def test_the_base_rate_of_a_user_who_minds_glasses_alone_blames_a_glass(
    layouts: Layouts, z_theta: np.ndarray, tables: Tables
):
    culprit = blame(told(layouts, z_theta, tables, NORMAL).necessity)
    chance = nulls(culprit, layouts.present, layouts.symbol, clearance(layouts, z_theta))["base_rate"]
    glasses = (layouts.symbol == SYMBOLS.index("glass")).sum(1)
    scene, path = np.nonzero(culprit != NOBODY)
    np.testing.assert_allclose(chance[scene, path], 1 / glasses[scene])


def test_the_base_rate_counts_paths_that_someone_is_to_blame_for():
    """A glass is the culprit of the one such path beside it, the bowl of 10 of the 11 beside that."""
    bowl, glass, plate = (SYMBOLS.index(s) for s in ("bowl", "glass", "plate"))
    culprit = np.full((2, 10), NOBODY)
    culprit[0, 3], culprit[1] = 1, 0
    symbol = np.array([[bowl, glass], [bowl, plate]])
    chance = nulls(culprit, np.ones((2, 2), bool), symbol, np.ones((2, 10, 2)))["base_rate"]
    assert chance[0, 3] == pytest.approx(1 / (1 + 10 / 11))
    assert chance[0].sum() == chance[0, 3] and (chance[1] == 1).all()


def test_of_several_culprits_each_must_be_enough_and_none_necessary():
    present = np.ones((2, 2), bool)
    several = {"whole": np.zeros((2, 1)), "empty": np.ones((2, 1)), "alone": np.zeros((2, 1, 2))}
    truth = Removals(without=np.zeros((2, 1, 2)), **several)  # either item alone forbids the path
    chances: dict = {}
    for without, right in ((0.0, 1.0), (1.0, 0.0)):  # the model: neither, or both, are necessary as well
        seen = {name: value[None] for name, value in several.items()}
        model = Removals(without=np.full((1, 2, 1, 2), without), **seen)
        found = study(model, truth, present, chances)
        assert found is not None and found["several_right"] == right


def test_a_model_that_looks_at_no_item_blames_none(layouts: Layouts, z_theta: np.ndarray, tables: Tables):
    truth = told(layouts, z_theta, tables, CAREFUL)
    blind = tables.fold(np.full((2, len(tables.scene), PATHS), 0.4))
    cell = study(blind, truth, layouts.present, {})
    assert cell is not None
    assert (cell["blame_right"], cell["named"], cell["several_right"], cell["empty_rejected"]) == (0, 0, 0, 1)
    items = layouts.present[:, None] & (truth.whole == 0)[..., None]
    assert cell["pn_error"] == pytest.approx(truth.necessity[items].mean(), abs=1e-6)
    accepting = tables.fold(np.full((2, len(tables.scene), PATHS), 0.9))
    assert study(accepting, truth, layouts.present, {}) is None


def test_a_cells_numbers_are_those_counted_by_hand():
    """One path in each of two scenes of two items, the first to blame in the first, both in the second."""
    one, none = np.ones((2, 1)), np.zeros((2, 1))
    truth = Removals(none, one, np.array([[[1.0, 0.0]], [[0.0, 0.0]]]), np.array([[[0.0, 1.0]], [[0.0, 0.0]]]))
    model = Removals(
        0.2 + none[None],
        0.9 + none[None],
        np.array([[[[0.6, 0.3]], [[0.4, 0.2]]]]),
        np.array([[[[0.3, 0.6]], [[0.18, 0.18]]]]),
    )
    cell = study(model, truth, np.ones((2, 2), bool), {})
    assert cell is not None
    np.testing.assert_allclose(model.necessity[0, :, 0], [[0.5, 0.125], [0.25, 0]])
    np.testing.assert_allclose(model.sufficiency[0, :, 0], [[2 / 3, 1 / 3], [0.8, 0.8]])
    assert (cell["rejected"], cell["single"], cell["recall"]) == (2, 0.5, 1)
    assert (cell["blame_right"], cell["blame_sure"], cell["several_right"]) == (1, 0, 1)
    assert cell["pn_error"] == pytest.approx((0.5 + 0.125 + 0.25 + 0) / 4)
    assert cell["ps_error"] == pytest.approx((1 / 3 + 1 / 3 + 0.2 + 0.2) / 4, abs=1e-6)
    assert (cell["pn_null"], cell["ps_null"]) == (0.25, 0.25)


def one_glass(x: float, y: float) -> Layouts:
    layouts = empty(1, 2)
    layouts.symbol[0, 0], layouts.item[0, 0], layouts.radius[0, 0] = SYMBOLS.index("glass"), 3, 0.04
    layouts.centre[0, 0] = x, y
    return layouts


def test_a_glass_slides_off_a_straight_path_by_what_the_margin_lacks():
    layouts, slot, z = one_glass(0.5, 0.52), np.array([0]), np.array([[0.5, 0.5]])
    direction = away(layouts, slot, z)
    np.testing.assert_allclose(direction, [[-(0.5**0.5), 0.5**0.5]])  # the path runs up the diagonal
    steps = np.linspace(0, 0.12, 121)
    moved = slide(layouts, slot, direction, steps)
    np.testing.assert_allclose(np.linalg.norm(moved.centre[:, 0] - layouts.centre[0, 0], axis=1), steps, atol=1e-12)
    room = slack(moved, clearance(moved, np.repeat(z, 121, axis=0)[:, None]), NORMAL)
    expected = 0.04 + 0.045 - 0.02 * 0.5**0.5
    assert crossing(steps, room.T, 0.0) == pytest.approx(expected, abs=0.0005)
    np.testing.assert_array_equal(layouts.centre[0, 0], [0.5, 0.52])  # the scene itself stays as it was


def test_where_random_scenes_have_their_items_they_fit_and_off_the_range_or_too_close_they_do_not(layouts: Layouts):
    slot = np.zeros(SCENES, int)
    assert fits(layouts, slot, RULES).all()
    off = slide(layouts, slot, np.tile([1.0, 0.0], (SCENES, 1)), np.array([0.9]))
    assert not fits(off, slot, RULES).any()
    onto = layouts[np.arange(SCENES)]
    onto.centre[:, 0] = onto.centre[:, 1]
    assert not fits(onto, slot, RULES).any()


@pytest.mark.parametrize(
    ("at", "fitting"), [(0.15, False), (0.85, False), (0.5, True), (0.2, True), (0.8, True)]
)  # a glass of 4 cm, from the ends at .08 and .92
def test_an_item_too_close_to_where_paths_begin_or_end_does_not_fit(at: float, fitting: bool):
    assert fits(one_glass(at, at), np.array([0]), RULES) == [fitting]


@pytest.mark.parametrize(
    ("values", "expected"),
    [([0.1, 0.3, 0.7], 1.5), ([0.6, 0.1, 0.1], 0.0), ([0.1, 0.2, 0.5], np.nan), ([0.0, 1.0, 0.0], 0.5)],
)
def test_a_crossing_is_the_first_one_linear_between_steps(values: list, expected: float):
    np.testing.assert_allclose(crossing(np.arange(3.0), np.array([values]), 0.5), [expected])


def test_least_moves_are_held_against_the_truth_where_a_model_rejects_and_finds_one():
    true_m = np.array([0.02, 0.04, 0.06])
    found = np.array([[0.03, np.nan, 0.05], [0.02, 0.04, 0.06]])
    rejected = np.array([[True, True, True], [True, True, False]])
    cell = move_study(found, rejected, true_m)
    assert cell is not None
    assert (cell["cases"], cell["true_m"], cell["rejected"], cell["found"]) == (3, 0.04, 0.833333, 0.8)
    assert (cell["error_m"], cell["bias_m"]) == (0.005, 0.0)
    assert cell["null_error_m"] == pytest.approx((0.02 + 0.02 + 0.02 + 0) / 4)
    assert cell["error_m_ci_low"] is None and cell["found_ci_high"] is None  # too few for an interval
    seeds = move_study(np.repeat(found, 15, axis=0), np.ones((30, 3), bool), true_m)
    assert seeds is not None and seeds["error_m_ci_low"] is None  # many pairs, but three scenes
    many = move_study(np.tile(found, (2, 4)), np.ones((4, 12), bool), np.tile(true_m, 4))
    assert many is not None and many["error_m_ci_low"] < many["error_m"] < many["error_m_ci_high"]
    assert move_study(found, np.zeros((2, 3), bool), true_m) is None


def test_the_first_path_of_the_first_scene_still_free_is_taken():
    where = np.zeros((3, 4), bool)
    where[1, 2] = where[1, 3] = where[2, 0] = True
    assert (first(where, []), first(where, [1]), first(where, [1, 2])) == ((1, 2), (2, 0), None)


def test_users_are_unlike_where_they_blame_another_or_one_accepts():
    rejected = np.array([[[True, True, True, True]], [[True, True, False, False]]])
    culprit = np.array([[[0, NOBODY, 1, NOBODY]], [[0, 1, NOBODY, NOBODY]]])
    disagree, one_accepts = unlike(rejected, culprit)
    np.testing.assert_array_equal(disagree, [[False, True, False, False]])
    np.testing.assert_array_equal(one_accepts, [[False, False, True, False]])
