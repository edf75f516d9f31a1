"""The repair stage compares every model's repairs with the truth, with baselines and with the oracle."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch
from omegaconf import DictConfig
from safetensors.torch import load_file

from pipeline.artifacts.files import read_table
from pipeline.artifacts.models import model_dir, save_weights, weights_path
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.models.trained import load_model
from pipeline.runtime.errors import InputError
from pipeline.stages.repair import main
from tests.factories import models_in_rendered_scenes, rendered_scenes

pytestmark = pytest.mark.slow
VARIANTS = ("full", "irl_ranked", "clearance")
BY_MODEL, BASELINES = ["gradient", "plain", "nearest"], ["random_path", "constant_detour", "oracle"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    small = ["seeds=[0,1]", "repair.starts=8", "repair.lattice_side=14", "repair.steps=4"]
    cfg = models_in_rendered_scenes(tmp_path_factory.mktemp("inputs"), VARIANTS, 3, *small)
    rendered_scenes(cfg, {"new_items": (3, "unseen")} | {train_pool(seed): (3, "train") for seed in cfg.seeds})
    return cfg


@pytest.fixture
def table(out: Path) -> pd.DataFrame:
    return read_table(out / "repairs.parquet")


def test_every_method_repairs_the_same_invalid_starts(table: pd.DataFrame):
    key = ["seed", "scene", "start", "z0_x", "z0_y", "oracle_displacement_m"]
    for _, of_user in table[~table["method"].isin(["same_starts", "policy"])].groupby("user"):
        starts = [part[key].to_numpy() for _, part in of_user.groupby(["method", "variant"])]
        assert len(starts) == 3 * len(BY_MODEL) + len(BASELINES)
        for other in starts[1:]:
            np.testing.assert_array_equal(starts[0], other)


def test_the_same_starts_are_given_to_every_user_and_always_end_valid_to_one_who_avoids_nothing(table: pd.DataFrame):
    shared = table[table["method"] == "same_starts"]
    starts = [part[["seed", "scene", "start"]].to_numpy() for _, part in shared.groupby(["variant", "user"])]
    assert len(starts) == 3 * len(VARIANTS)
    assert all((one == starts[0]).all() for one in starts)
    assert shared.loc[shared["user"] == "aggressive", "valid_end"].all()
    both = shared.merge(table[table["method"] == "gradient"], on=["variant", "user", "seed", "scene", "start"])
    assert len(both) and (both["z_x_x"] == both["z_x_y"]).all()


def test_irl_s_own_policy_is_one_path_a_scene_that_no_other_method_exceeds_in_return(table: pd.DataFrame):
    policy = table[table["method"] == "policy"]
    key = ["user", "seed", "scene"]
    assert set(policy["variant"]) == {"irl_ranked"} and not policy.duplicated(key).any()
    others = table[(table["variant"] == "irl_ranked") & (table["method"] != "policy")]
    best = others.groupby(key)["p_end"].max()
    assert (policy.set_index(key)["p_end"].loc[best.index] >= best - 0.02).all()  # to the lattice's resolution


def test_probabilities_are_the_models(cfg: DictConfig, table: pd.DataFrame):
    scenes = read_scenes(Path(cfg.paths.scenes))
    rows = table.query("method == 'nearest' and variant == 'irl_ranked' and user == 'careful' and seed == 1")
    images = scenes.images["new_items"][rows["scene"]]
    model = load_model(cfg, "irl_ranked", "careful", 1, cfg.main_n_demos)
    for columns, p in ((["z0_x", "z0_y"], "p_start"), (["z_x", "z_y"], "p_end")):
        expected = model.probability(images, rows[columns].to_numpy()[:, None])[:, 0]
        np.testing.assert_allclose(rows[p], expected, atol=1e-5)


def test_the_summary_and_the_metrics_are_of_the_table_s_users_with_an_invalid_path(out: Path, table: pd.DataFrame):
    summary = read_table(out / "summary.csv").fillna({"variant": ""}).set_index(["method", "variant", "user"])
    metrics = json.loads((out / "metrics.json").read_text())
    assert set(summary.index.get_level_values("user")) == set(table["user"]) == {"careful", "normal", "aggressive"}
    for key, rows in table.groupby(["method", "variant", "user"]):
        row = summary.loc[key]
        assert row["success"] == pytest.approx(rows["valid_end"].mean(), rel=1e-5)
        assert row["seeds"] * row["starts"] == len(rows)
    for variant in VARIANTS:
        success = summary.loc[("gradient", variant, "careful"), "success"]
        assert metrics["repair"][variant]["careful"] == pytest.approx(success, rel=1e-5)
    search = summary.loc[("nearest", "clearance", "normal")]
    for name, value in metrics["search"]["clearance"]["normal"].items():
        assert value == pytest.approx(search[name], rel=1e-5)


def test_a_model_with_nan_and_a_missing_one_are_named_and_nothing_written(cfg: DictConfig, tmp_path: Path):
    path = weights_path(model_dir(cfg, "full"), "careful", cfg.protocol.seeds[-1], cfg.main_n_demos)
    weights = load_file(path)
    name = next(name for name, value in weights.items() if value.is_floating_point())
    save_weights(path, weights | {name: torch.full_like(weights[name], torch.nan)})
    with pytest.raises(InputError, match=rf"{path.name} has NaN or infinite values in {name}: delete it and fit"):
        main(cfg, tmp_path / "out")
    path.unlink()
    with pytest.raises(InputError, match=f"{path.name} is missing: run stage"):
        main(cfg, tmp_path / "out")
    assert not (tmp_path / "out").exists()
