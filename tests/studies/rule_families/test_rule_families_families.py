"""Rules of other forms forgive what they say, and nothing else."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from tests.report_artefacts import ITEMS

from pipeline.params import compose
from pipeline.world.bezier import curve, random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts, empty, random_layouts
from pipeline.world.rules import Margins, valid
from studies.rule_families.families import FORMS, beside, brief, late, margin, right, several
from tests.examples import RULES

USERS = compose(["profile=smoke"]).users
AMOUNTS = {"margin": 0.0, "brief": 0.1, "right": 0.0, "beside": 0.2, "late": 0.5, "several": 2.0}
Drawn = tuple[Layouts, np.ndarray]
ALL: Margins = {symbol: 0.045 for symbol in SYMBOLS}


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    rng = np.random.default_rng(0)
    layouts = random_layouts(rng, 40, ITEMS, np.arange(4), RULES)
    return layouts, random_z_theta(rng, 40, 60)


def glasses(*centres: tuple[float, float]) -> Layouts:
    """One scene with a glass of 3 cm radius at each of these places [m]."""
    layouts = empty(1, len(centres) + 1)
    for slot, centre in enumerate(centres):
        layouts.symbol[0, slot], layouts.item[0, slot] = SYMBOLS.index("glass"), 0
        layouts.centre[0, slot], layouts.radius[0, slot], layouts.scale[0, slot] = centre, 0.03, 1.0
    return layouts


@pytest.mark.parametrize("user", ["careful", "normal", "aggressive"])
@pytest.mark.parametrize("form", list(FORMS))
def test_what_keeps_every_margin_is_valid_by_every_form(drawn: Drawn, form: str, user: str):
    layouts, z = drawn
    kept, found = valid(layouts, z, USERS[user]), FORMS[form](layouts, z, USERS[user], AMOUNTS[form])
    assert found[kept].all()
    forgives = user != "aggressive" and form != "margin"
    assert (found & ~kept).any() == forgives and (~found).any() == (user != "aggressive")


def test_the_users_own_form_is_their_rule(drawn: Drawn):
    np.testing.assert_array_equal(margin(*drawn, ALL, 0.0), valid(*drawn, ALL))


@pytest.mark.parametrize(
    ("form", "nothing"), [("brief", 1.0), ("right", 10.0), ("beside", -10.0), ("late", 1.0), ("several", 5.0)]
)
def test_an_amount_beyond_all_forgives_everything(drawn: Drawn, form: str, nothing: float):
    assert FORMS[form](*drawn, ALL, nothing).all()


def test_forgiving_no_share_of_the_way_or_any_company_is_the_users_own_rule(drawn: Drawn):
    own = valid(*drawn, ALL)
    for nothing in (late(*drawn, ALL, -1.0), several(*drawn, ALL, 1.0)):
        assert (nothing == own).mean() > 0.998
    np.testing.assert_array_equal(beside(*drawn, ALL, 10.0), own)
    assert (brief(*drawn, ALL, 0.0) == own).mean() > 0.998  # but for paths that only graze, between two points


def test_the_share_of_the_way_is_that_of_evenly_timed_points(drawn: Drawn):
    layouts, z = drawn
    ends, points = layouts.ends[0], curve(z[:1], 129)[0]
    near = np.zeros(points.shape[:2], bool)
    for slot in np.flatnonzero(layouts.present[0]):
        segment = ends[slot, 0] + np.linspace(0, 1, 400)[:, None] * (ends[slot, 1] - ends[slot, 0])
        distance = cdist(points.reshape(-1, 2), segment).min(1).reshape(near.shape)
        near |= distance < layouts.radius[0, slot] + 0.045
    for share in (0.05, 0.1, 0.2):
        agree = brief(layouts[:1], z[:1], ALL, share)[0] == (near.mean(-1) <= share)
        assert agree.mean() > 0.95


def test_the_straight_path_minds_what_is_below_the_diagonal_and_not_what_is_above():
    z = np.array([[[0.5, 0.5]]])
    assert not right(glasses((0.54, 0.46)), z, ALL, 0.0)[0, 0]
    assert right(glasses((0.46, 0.54)), z, ALL, 0.0)[0, 0]
    assert not right(glasses((0.46, 0.54), (0.7, 0.67)), z, ALL, 0.0)[0, 0]
    assert right(glasses((0.54, 0.46)), z, ALL, 0.06)[0, 0]  # its middle lies 5.7 cm aside


def test_a_glass_alone_is_forgiven_and_beside_another_is_not_though_that_be_far_from_the_path():
    z = np.array([[[0.5, 0.5]]])
    assert beside(glasses((0.5, 0.5)), z, ALL, 0.2)[0, 0]
    assert not beside(glasses((0.5, 0.5), (0.6, 0.3)), z, ALL, 0.2)[0, 0]
    assert beside(glasses((0.5, 0.5), (0.8, 0.3)), z, ALL, 0.2)[0, 0]
    assert beside(glasses((0.5, 0.5), (0.6, 0.3)), z, USERS.aggressive, 0.2)[0, 0]


def test_only_what_comes_late_is_minded():
    z = np.array([[[0.5, 0.5]]])
    first, last = glasses((0.3, 0.3)), glasses((0.7, 0.7))
    assert late(first, z, ALL, 0.5)[0, 0] and not late(last, z, ALL, 0.5)[0, 0]
    assert not late(first, z, ALL, 0.2)[0, 0]


def test_one_thing_too_near_is_forgiven_and_two_are_not():
    z = np.array([[[0.5, 0.5]]])
    assert several(glasses((0.3, 0.3)), z, ALL, 2.0)[0, 0]
    assert not several(glasses((0.3, 0.3), (0.7, 0.7)), z, ALL, 2.0)[0, 0]
    assert several(glasses((0.3, 0.3), (0.3, 0.7)), z, ALL, 2.0)[0, 0]
