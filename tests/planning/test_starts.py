"""Repairs start from paths that are invalid to their user, and their table says what a model accepts."""

import numpy as np

from pipeline.planning.starts import Starts, rows
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, random_layouts
from pipeline.world.rules import valid
from tests.factories import ITEMS, RULES

MARGINS = dict.fromkeys(SYMBOLS, 0.045)


def test_starts_are_the_invalid_candidates_and_only_ends_that_a_model_accepts_are_accepted():
    rng = np.random.default_rng(0)
    layouts = random_layouts(rng, 3, ITEMS, np.arange(4), RULES)
    candidates = random_z_theta(rng, 3, 8)
    s = Starts.of("careful", MARGINS, layouts, candidates, 14, 1)
    truth = valid(layouts, candidates, MARGINS)
    assert len(s.z) == (~truth).sum() > 0 and not truth[s.scene, s.start].any()
    np.testing.assert_array_equal(s.z, candidates[s.scene, s.start])

    p = np.linspace(0, 1, len(s.z))
    table = rows(s, "gradient", "full", 0, s.nearest, p, p)
    assert (table["accepted"] == (p > 0.5)).all()
    assert table["valid_end"].all() and (table["displacement_m"] == table["oracle_displacement_m"]).all()
    baseline = rows(s, "oracle", "", 0, s.nearest)
    assert baseline[["accepted", "p_start", "p_end"]].isna().all(axis=None)
