"""What the figure of found things counts."""

from dataclasses import replace

import numpy as np

from pipeline.report.figures.things import Things, lies_on
from pipeline.table.layout import empty


def test_a_thing_lies_on_the_item_that_its_middle_is_in():
    layouts = replace(empty(1, 2), centre=np.array([[[0.3, 0.3], [0.7, 0.7]]]))
    layouts.symbol[0], layouts.item[0] = (0, 3), (0, 3)
    layouts.radius[0], layouts.half_length[0] = (0.05, 0.02), (0.0, 0.1)
    things = Things(np.zeros((1, 5, 2, 2)), np.full((1, 5), 0.05), np.zeros((1, 5), bool))
    things.ends[0, :4] = np.array([[0.3, 0.34], [0.78, 0.7], [0.3, 0.36], [0.3, 0.3]])[:, None]
    things.present[0, :3] = True
    on = lies_on(things, layouts)[0]
    assert on[:4].tolist() == [[True, False], [False, True], [False, False], [False, False]]
    assert not on[4:].any()
