"""An outline fills the disc or capsule it is drawn for, from end to end, and no more."""

import numpy as np
import pytest

from drawing.outline import ROUND, cut, eared, oval, polygon, scalloped, spouted
from drawing.shading import FINE, grid

OUTLINES = {
    "round": ROUND,
    "oval": oval(0.5),
    "square": polygon(4, 3.5),
    "octagon": polygon(8, 120.0),
    "scalloped": scalloped(6, 0.2),
    "two ears": eared(0.22, 2, 0.46),
    "handle": eared(0.22, 1, 0.46),
    "spouted": spouted(0.16),
}


@pytest.mark.parametrize("name", OUTLINES)
def test_an_outline_lies_in_its_footprint_and_reaches_both_ends(name):
    outline = OUTLINES[name]
    x, y = grid()
    drawn = outline(x, y) < 1
    reach = 1 + outline.stretch
    off = np.hypot(np.maximum(np.abs(x * reach) - outline.stretch, 0), y * reach) - 1
    assert off[drawn].max() < 2 / FINE
    assert (drawn & (off < 0)).sum() > 0.85 * (off < 0).sum()
    assert x[drawn].max() - x[drawn].min() > 2 * 0.99


def test_an_even_polygon_of_sharpness_2_is_a_circle_and_facets_leave_it_almost_as_it_was():
    x, y = grid()
    np.testing.assert_allclose(polygon(6, 2.0)(x, y), np.hypot(x, y))
    ratio = cut(10)(x, y) / ROUND(x, y)
    assert ratio.min() > 0.96 and ratio.max() < 1.03
