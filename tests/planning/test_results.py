"""Repairs start from paths that are invalid to their user, and are measured by the truth."""

import numpy as np
import pandas as pd
import pytest

from pipeline.planning.results import Starts, measures, rows
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
    p = np.linspace(0, 1, len(s.z))
    table = rows(s, "gradient", "full", 0, s.nearest, p, p)
    assert (table["accepted"] == (p > 0.5)).all()
    assert table["valid_end"].all() and (table["displacement_m"] == table["oracle_displacement_m"]).all()
    baseline = rows(s, "oracle", "", 0, s.nearest)
    assert baseline[["accepted", "p_start", "p_end"]].isna().all(axis=None)


def measured(valid: np.ndarray, accepted: np.ndarray | bool | None = True, **columns: object) -> pd.Series:
    """The measures of repairs `valid` and `accepted` by seed and scene, two starts in each scene."""
    seed, scene = (np.repeat(index.ravel(), 2) for index in np.indices(valid.shape))
    called = np.repeat(np.broadcast_to(np.array(accepted, dtype=object), valid.shape).ravel(), 2)
    table = {
        "method": "gradient", "variant": "full", "user": "careful", "seed": seed, "scene": scene,
        "valid_end": np.repeat(valid.ravel(), 2), "accepted": pd.array(called, dtype="boolean"),
        "displacement_m": 1.0, "oracle_displacement_m": 0.5,
    }  # fmt: skip
    (row,) = measures(pd.DataFrame(table | columns)).iloc  # type: ignore[arg-type]
    return row


def test_unsafe_repairs_are_accepted_though_invalid_and_baselines_do_not_accept():
    valid, accepted = np.array([[True, False, False], [True, True, False]]), np.array([[True, True, False]] * 2)
    row = measured(valid, accepted)
    assert row["unsafe"] == pytest.approx(1 / 6) and row["accepted"] == pytest.approx(4 / 6)
    row = measured(np.array([[True], [False]]), None)
    assert row[["accepted", "unsafe", "success_ci_low", "success_ci_high"]].isna().all()
