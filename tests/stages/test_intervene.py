"""The stage changes nothing but what it says it changes, and writes the same answers twice."""

from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_json, read_table
from pipeline.artifacts.scenes import read_scenes
from pipeline.artifacts.trained import load_model
from pipeline.stages import intervene
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import SYMBOLS
from tests.stages.facts import names_a_missing_model, refuses, repeats_itself
from tests.stages.inputs import pictured_models

SCENES, PATHS, PLACEMENTS = 4, 6, 2
VARIANTS = ("full", "irl_ranked", "path")
KEPT = ("effects.parquet", "specifications.parquet", "images.npz", "layouts.parquet", "table.csv", "metrics.json")


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    settings = [f"intervene.paths={PATHS}", f"intervene.placements={PLACEMENTS}"]
    return pictured_models(tmp_path_factory.mktemp("intervene"), VARIANTS, SCENES, *settings)


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    intervene.main(cfg, directory)
    return directory


def test_there_is_a_row_for_every_answer(cfg: DictConfig, out: Path):
    cells = len(VARIANTS) * len(cfg.protocol.seeds) * SCENES
    assert len(read_table(out / "effects.parquet")) == cells * len(cfg.users) * len(SYMBOLS) * PLACEMENTS
    assert len(read_table(out / "specifications.parquet")) == cells * 6


def test_one_unseen_item_of_the_symbol_is_added_and_nothing_else_moves(cfg: DictConfig, out: Path):
    scenes, added = read_scenes(Path(cfg.paths.scenes)), read_table(out / "layouts.parquet")
    unseen = read_catalogue(Path(cfg.paths.data)).pool("unseen")
    before = scenes.layouts["new_items"]
    for (pool, scene), items in added.groupby(["pool", "scene"]):
        count = before.present[scene].sum()
        np.testing.assert_array_equal(items["item"].to_numpy()[:-1], before.item[scene, :count])
        np.testing.assert_array_equal(items["x_m"].to_numpy()[:-1], before.centre[scene, :count, 0])
        assert SYMBOLS[items["symbol"].iloc[-1]] == str(pool).split("-")[0]
        assert items["item"].iloc[-1] in unseen


def test_pixels_far_from_the_added_item_are_the_same(cfg: DictConfig, out: Path):
    before = read_scenes(Path(cfg.paths.scenes)).images["new_items"]
    after = read_arrays(out / "images.npz")["images"]
    assert after.shape == (len(SYMBOLS), PLACEMENTS, SCENES, 100, 100, 3)
    changed = (after != before).any(-1).mean((-1, -2))  # share of each picture's pixels
    assert (changed > 0).all()
    assert (changed < 0.15).all()  # the largest plate and its shadow


def test_before_and_after_a_model_judges_the_same_paths(cfg: DictConfig, out: Path):
    arrays, rows = read_arrays(out / "images.npz"), read_table(out / "effects.parquet")
    assert arrays["z_theta"].shape == (SCENES, PATHS, 2)
    user, seed = "normal", cfg.protocol.seeds[1]
    model = load_model(cfg, "full", user, seed, cfg.main_n_demos)
    torch.set_num_threads(1)
    expected = model.probability(arrays["images"][2, 1], arrays["z_theta"]).mean(-1)  # the second cutlery
    keys = {"variant": "full", "user": user, "seed": seed, "symbol": "cutlery", "placement": 1}
    chosen = rows[np.logical_and.reduce([rows[k] == v for k, v in keys.items()])].sort_values("scene")
    np.testing.assert_allclose(chosen["intervened"], expected, atol=1e-6)


def test_in_truth_one_item_more_makes_nothing_valid_and_the_aggressive_user_minds_nothing(out: Path):
    rows = read_table(out / "effects.parquet")
    assert (rows["true_effect"] <= 0).all()
    assert (rows.loc[rows["user"] == "aggressive", "true_intervened"] == 1).all()
    others = rows[(rows["user"] == "normal") & (rows["symbol"] != "glass")]
    assert (others["true_effect"] == 0).all()


def test_another_user_and_back_again_is_no_change(out: Path):
    rows = read_table(out / "specifications.parquet")
    there = rows[(rows["user"] == "careful") & (rows["other"] == "normal")]
    back = rows[(rows["user"] == "normal") & (rows["other"] == "careful")]
    for effect in ("effect", "true_effect"):
        np.testing.assert_array_equal(there[effect].to_numpy(), -back[effect].to_numpy())
    assert (there["true_effect"] > 0).any()


def test_the_metrics_sum_the_rows_up(cfg: DictConfig, out: Path):
    metrics, rows = read_json(out / "metrics.json"), read_table(out / "effects.parquet")
    means = rows.groupby(["variant", "user", "symbol"])[["effect", "true_effect"]].mean()
    for (variant, user, symbol), mean in means.iterrows():  # pyright: ignore[reportGeneralTypeIssues]
        cell = metrics["interventions"][variant][user][symbol]
        assert cell["effect"] == pytest.approx(mean["effect"], abs=1e-6)
        assert cell["truth"] == pytest.approx(mean["true_effect"], abs=1e-6)
        assert cell["verdict"] != "effect"  # two seeds cannot be enough
    assert set(metrics["specifications"]["full"]["careful"]) == set(cfg.users) - {"careful"}
    assert metrics["verdicts"]["full"]["cells"] == 12
    assert len(read_table(out / "table.csv")) == 12 * len(VARIANTS)


def test_a_second_run_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    assert sorted(p.name for p in out.iterdir()) == sorted(KEPT)
    repeats_itself(intervene.main, cfg, out, tmp_path)


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(intervene.main, cfg, "irl_ranked", tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("paths", 0, "intervene.paths is 0"), ("split", "seen_scenes", "expected a split that all seeds share")],
)
def test_parameters_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name, value, message):
    refuses(intervene.main, cfg, f"intervene.{name}", value, message, tmp_path / "out")
