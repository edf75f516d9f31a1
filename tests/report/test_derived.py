"""Judged paths: what they are like, and scores by slices of them."""

import numpy as np
import pandas as pd
import pytest

from pipeline.report.derived import NOTHING, by_slice, describe, overlap
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import random_layouts
from pipeline.world.rules import clearance, slack
from tests.report import factory


@pytest.fixture(scope="module")
def judged() -> pd.DataFrame:
    return factory.tables()["judged"]


@pytest.mark.parametrize("user", ["careful", "normal"])
def test_a_path_is_described_by_its_slack_and_its_scene(user: str):
    rng, margins = np.random.default_rng(3), factory.MARGINS[user]
    catalogue = factory.catalogue_of(factory.DATA)
    layouts = random_layouts(rng, 6, catalogue.footprints, catalogue.pool("unseen"), factory.RULES)
    z_theta = random_z_theta(rng, 6, 40)
    rows = describe(layouts, z_theta, margins, ["oak"] * 6)
    slacks = slack(layouts, clearance(layouts, z_theta), margins).ravel()
    near = np.abs(slacks) < 0.01
    assert near.any() and (rows["distance"][near] == "0 to 1 cm").all()
    assert (rows["distance"] == NOTHING).equals(pd.Series(np.isinf(slacks)))
    assert (rows["items"].to_numpy() == np.repeat(layouts.present.sum(1), 40)).all()
    if user == "normal":
        assert set(rows["nearest"]) <= {"glass", NOTHING}


def test_slices_of_a_kind_add_up_to_all(judged: pd.DataFrame):
    for (variant, split), rows in by_slice(judged).groupby(["variant", "split"]):
        right = (rows["accuracy"] * rows["count"]).groupby(rows["slice"]).sum()
        np.testing.assert_allclose(right, right["all"], err_msg=f"{variant}, {split}")
        np.testing.assert_allclose(rows.groupby("slice")["share"].sum(), 1.0)


def test_unsafe_is_the_invalid_share_of_what_is_accepted(judged: pd.DataFrame):
    whole = by_slice(judged.head(4).assign(p=[0.9, 0.9, 0.9, 0.1], valid=[True, False, True, True])).iloc[0]
    assert (whole["unsafe"], whole["refused"], whole["accuracy"]) == pytest.approx((1 / 3, 1 / 3, 1 / 2))


def test_a_model_that_knows_the_truth_finds_all_of_the_overlap(judged: pd.DataFrame):
    rows = overlap(factory.results(judged=judged.assign(p=judged["valid"].astype(float))))
    assert (rows["overlap_found"] == 1).all()
    np.testing.assert_allclose(rows[["both", "first", "second", "neither"]].sum(axis=1), 1.0)
