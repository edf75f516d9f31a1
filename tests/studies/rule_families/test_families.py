"""Each rule family forgives what it says and forbids no path that keeps every margin."""

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from pipeline.world.bezier import curve, random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts, empty, random_layouts
from pipeline.world.rules import Margins, valid
from studies.rule_families.families import FAMILIES, OWN_FAMILY, dwell, margin, proximity, side
from tests.factories import ITEMS, RULES, composed

USERS = composed("profile=smoke").users
AMOUNTS = {"margin": 0.0, "dwell": 0.1, "side": 0.0, "proximity": 0.2}
ALL: Margins = {symbol: 0.045 for symbol in SYMBOLS}
STRAIGHT = np.array([[[0.5, 0.5]]])
Drawn = tuple[Layouts, np.ndarray]


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    rng = np.random.default_rng(0)
    return random_layouts(rng, 40, ITEMS, np.arange(4), RULES), random_z_theta(rng, 40, 60)


def glasses(*centres: tuple[float, float]) -> Layouts:
    """Return one scene with a glass of 3 cm radius at each of these places [m]."""
    layouts = empty(1, len(centres) + 1)
    for slot, centre in enumerate(centres):
        layouts.symbol[0, slot], layouts.item[0, slot] = SYMBOLS.index("glass"), 0
        layouts.centre[0, slot], layouts.radius[0, slot], layouts.scale[0, slot] = centre, 0.03, 1.0
    return layouts


@pytest.mark.parametrize("user", ["careful", "normal", "aggressive"])
@pytest.mark.parametrize("family", FAMILIES)
def test_a_path_that_keeps_every_margin_is_valid_in_every_family(drawn: Drawn, family: str, user: str):
    kept = valid(*drawn, USERS[user])
    accepted = FAMILIES[family](*drawn, USERS[user], AMOUNTS[family])
    assert accepted[kept].all()
    has_margins = user != "aggressive"
    assert (accepted & ~kept).any() == (has_margins and family != OWN_FAMILY)
    assert (~accepted).any() == has_margins


@pytest.mark.parametrize(("family", "amount"), [("dwell", 1.0), ("side", 10.0), ("proximity", -10.0)])
def test_an_extreme_amount_forgives_every_path(drawn: Drawn, family: str, amount: float):
    assert FAMILIES[family](*drawn, ALL, amount).all()


def test_without_forgiveness_every_family_is_the_users_own_rule(drawn: Drawn):
    own = valid(*drawn, ALL)
    for unforgiving in (margin(*drawn, ALL, 0.0), proximity(*drawn, ALL, 10.0), side(*drawn, ALL, -10.0)):
        assert (unforgiving == own).mean() > 0.998
    assert (dwell(*drawn, ALL, 0.0) == own).mean() > 0.998  # but for paths that graze a margin between two points


def test_dwell_measures_the_share_of_evenly_timed_points_within_a_margin(drawn: Drawn):
    layouts, z_theta = drawn
    ends, points = layouts.ends[0], curve(z_theta[:1], 129)[0]
    inside = np.zeros(points.shape[:2], bool)
    for slot in np.flatnonzero(layouts.present[0]):
        segment = ends[slot, 0] + np.linspace(0, 1, 400)[:, None] * (ends[slot, 1] - ends[slot, 0])
        distance = cdist(points.reshape(-1, 2), segment).min(1).reshape(inside.shape)
        inside |= distance < layouts.radius[0, slot] + 0.045
    for share in (0.05, 0.1, 0.2):
        agree = dwell(layouts[:1], z_theta[:1], ALL, share)[0] == (inside.mean(-1) <= share)
        assert agree.mean() > 0.95


def test_side_counts_items_below_the_straight_path_and_none_above_it():
    assert not side(glasses((0.54, 0.46)), STRAIGHT, ALL, 0.0)[0, 0]
    assert side(glasses((0.46, 0.54)), STRAIGHT, ALL, 0.0)[0, 0]
    assert not side(glasses((0.46, 0.54), (0.7, 0.67)), STRAIGHT, ALL, 0.0)[0, 0]
    assert side(glasses((0.54, 0.46)), STRAIGHT, ALL, 0.06)[0, 0]  # its centre lies 5.7 cm aside


def test_proximity_counts_a_glass_with_a_neighbour_even_if_that_is_far_from_the_path():
    assert proximity(glasses((0.5, 0.5)), STRAIGHT, ALL, 0.2)[0, 0]
    assert not proximity(glasses((0.5, 0.5), (0.6, 0.3)), STRAIGHT, ALL, 0.2)[0, 0]
    assert proximity(glasses((0.5, 0.5), (0.8, 0.3)), STRAIGHT, ALL, 0.2)[0, 0]
    assert proximity(glasses((0.5, 0.5), (0.6, 0.3)), STRAIGHT, USERS.aggressive, 0.2)[0, 0]
