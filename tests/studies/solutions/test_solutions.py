"""Clusters, routes and verdicts on cases whose answer is known; the stage's tables agree with each other."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_arrays
from pipeline.world.layout import Layouts, empty
from studies.solutions.clusters import Paths, best_accuracy, measures, routes
from studies.solutions.stage import judge, left_of_items, main
from tests.factories import labelled_demos, models_in_rendered_scenes, same_scenes_for_training
from tests.stages.facts import names_a_missing_model

VARIANTS, SCENES = ("full", "clearance"), 5


def test_users_far_apart_are_named_and_users_alike_are_not():
    rng, user = np.random.default_rng(0), np.tile([0, 1, 2], 60)
    scene = np.repeat(np.arange(18), 10)
    noise = rng.normal(0, 0.05, (180, 2))
    apart = measures(Paths(noise + user[:, None], scene, user), 5, rng, 19)
    assert (apart[0, :2] == 1).all() and apart[0, 2] > 0.8
    assert (apart[1:, 2] < 0).all() and (apart[1:, :2] < 0.6).all()  # shuffled within scenes
    alike = measures(Paths(noise, scene, user), 5, rng, 199)[:, 0]
    assert alike[0] == pytest.approx(1 / 3, abs=0.12) and alike.mean() == pytest.approx(1 / 3, abs=0.02)


def test_a_perfect_clusterer_is_right_where_valid_sets_differ():
    nested = np.array([[1, 0, 0, 0], [1, 1, 0, 0], [1, 1, 1, 1]], float)  # best: 1 + 1/2 + 2/4, over three users
    assert best_accuracy(nested) == pytest.approx(2 / 3)
    assert best_accuracy(np.eye(3)) == 1 and best_accuracy(np.ones((3, 7))) == pytest.approx(1 / 3)
    with_a_closed_table = np.stack([nested, np.zeros_like(nested)], axis=1)
    assert best_accuracy(with_a_closed_table) == pytest.approx(2 / 3)


@pytest.fixture
def one_item() -> Layouts:
    """A glass in the middle of the table, on the straight line between the ends."""
    layouts = empty(1, 2)
    layouts.symbol[0, 0], layouts.item[0, 0], layouts.centre[0, 0] = 3, 0, (0.5, 0.49)
    return layouts


def test_a_path_has_an_item_on_the_side_away_from_its_control_point(one_item: Layouts):
    z = np.array([[[0.2, 1.0], [1.0, 0.2], [0.5, 0.5], [0.0, 0.02]]])  # above, below, straight, hardly bent
    margins = dict.fromkeys(("bowl", "plate", "cutlery"), None) | {"glass": 0.04}
    sides = left_of_items(one_item, z, margins)
    assert sides[0, :, 0].tolist() == [False, True, False, False] and not sides[..., 1].any()
    assert not left_of_items(one_item, z, dict.fromkeys(margins)).any()  # nothing to avoid, one route
    assert routes(sides, np.ones((1, 4), bool)).tolist() == [2] and routes(sides, np.zeros((1, 4), bool)).tolist() == [
        0
    ]


def test_a_verdict_needs_the_whole_interval_and_a_failure_a_bar_that_can_be_passed():
    assert [judge(0, *x) for x in [(0.1, 0.2, False), (-0.1, 0.2, True), (-0.2, -0.1, True), (-0.2, -0.1, False)]] == [
        "holds", "open", "fails", "open",
    ]  # fmt: skip


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    folder = tmp_path_factory.mktemp("solutions")
    cfg = models_in_rendered_scenes(folder, VARIANTS, SCENES, f"paths.demos={folder / 'demos'}")
    labelled_demos(cfg, same_scenes_for_training(cfg, "new_items"))
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", {user: np.full((14, 14), 0.6) for user in cfg.users})
    return cfg


def test_samples_of_the_truth_are_valid_and_no_source_finds_more_routes_than_there_are(cfg: DictConfig, out: Path):
    table = read_table(out / "sampling.csv")
    assert set(table["variant"]) == {*VARIANTS, "position_only", "random_path", "truth"}
    assert (table[table["variant"] == "truth"]["valid"] == 1).all() and table["valid"].between(0, 1).all()
    assert (table["routes_found"] <= table["routes_all"]).all()


def test_the_true_overlap_is_that_of_all_sources_and_a_constant_has_no_correlation(out: Path):
    table, scenes = read_table(out / "overlap.csv"), read_table(out / "overlap_scenes.csv")
    assert (table.groupby(["first", "second"])["truth"].nunique() == 1).all()
    assert (table[table["variant"] == "training_mean"]["correlation"] == 0).all()
    pd.testing.assert_series_equal(
        scenes.groupby(["variant", "first", "second"])["overlap"].mean(),
        table.set_index(["variant", "first", "second"])["overlap"].sort_index(), rtol=1e-4,
    )  # fmt: skip


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "clearance", tmp_path / "out")
