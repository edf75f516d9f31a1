"""The repair stage holds every model's ends against the truth, the nulls and the oracle."""

import json
from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.planning.oracle import constant_detour
from pipeline.stages.repair import main
from tests.stages.facts import names_a_missing_model, refuses, repeats_itself
from tests.stages.inputs import untrained_models


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    return untrained_models(tmp_path_factory.mktemp("inputs"), [0, 1], "repair.steps=4")


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("repair")
    main(cfg, out)
    return out


def test_every_method_repairs_the_same_invalid_starts(out: Path):
    table = read_table(out / "repairs.parquet")
    key = ["scene", "start", "z0_x", "z0_y", "oracle_displacement_m"]
    for _, of_user in table.groupby("user"):
        starts = [part[key].to_numpy() for _, part in of_user.groupby("method")]
        assert len(starts) == 6  # three variants, two nulls and the oracle
        for other in starts[1:]:
            np.testing.assert_array_equal(starts[0], other)


def test_paths_go_from_the_starts_to_the_ends_of_the_table(out: Path):
    paths = read_arrays(out / "paths.npz")
    table = read_table(out / "repairs.parquet")
    for (variant, user, seed), rows in table[table["p_end"].notna()].groupby(["method", "user", "seed"]):
        z = paths[f"{variant}-{user}-s{seed}"]
        assert z.shape == (len(rows), 5, 2) and z.dtype == np.float32
        np.testing.assert_allclose(z[:, 0], rows[["z0_x", "z0_y"]], atol=1e-6)
        np.testing.assert_allclose(z[:, -1], rows[["z_x", "z_y"]], atol=1e-6)
    assert paths["full-aggressive-s0"].shape == (0, 5, 2)


def test_the_constant_detour_is_chosen_in_the_seeds_own_training_scenes(cfg: DictConfig, out: Path):
    layouts = read_scenes(Path(cfg.paths.scenes)).layouts
    table = read_table(out / "repairs.parquet").query("method == 'constant_detour_baseline'")
    for (seed, user), rows in table.groupby(["seed", "user"]):
        detour = constant_detour(layouts[train_pool(seed)], cfg.users[user], cfg.repair.lattice_side)
        assert (rows[["z_x", "z_y"]] == detour).all(axis=None)


def test_random_ends_are_drawn_anew_for_every_seed_and_user_and_are_no_starts(out: Path):
    table = read_table(out / "repairs.parquet").query("method == 'random_path'")
    assert table.groupby(["seed", "user"]).ngroups == 4
    assert not table.duplicated(["z_x", "z_y"]).any()
    assert not table["z_x"].isin(table["z0_x"]).any()


def test_the_oracle_always_succeeds_and_no_success_with_room_is_shorter(out: Path):
    table = read_table(out / "repairs.parquet")
    assert table[table["method"] == "oracle"]["valid_end"].all()
    off = 1.4 / 14 / 2**0.5  # [m]: no z is further from the oracle's coarse lattice; its path moves half as far at most
    others = table[(table["clearance_m"] > off / 2) & (table["method"] != "oracle")]
    assert len(others) > 0
    assert (others["displacement_m"] >= others["oracle_displacement_m"] - off).all()


def test_correct_fooled_and_abstained_share_out_all_starts(out: Path):
    metrics = json.loads((out / "metrics.json").read_text())
    for by_user in metrics.values():
        for user in ("careful", "normal"):
            cell = by_user[user]
            assert cell["correct"] + cell["fooled"] + cell["abstained"] == pytest.approx(1)
            assert cell["correct"] <= cell["success"] <= cell["correct"] + cell["abstained"]
            assert cell["oracle"] == 1 and cell["oracle_displacement_ratio"] == pytest.approx(1)


def test_the_table_and_the_metrics_say_the_same(out: Path):
    cell = json.loads((out / "metrics.json").read_text())["full"]["careful"]
    rows = read_table(out / "repairs.parquet").query("method == 'full' and user == 'careful'")
    assert (rows.groupby("seed").size() == cell["starts"]).all()
    assert cell["success"] == pytest.approx(rows["valid_end"].mean())
    assert cell["fooled"] == pytest.approx((rows["accepted"].astype(bool) & ~rows["valid_end"]).mean())
    assert ((rows["clearance_m"] > 0) == rows["valid_end"]).all()


def test_a_user_whom_everything_suits_has_nothing_to_repair(out: Path):
    cell = json.loads((out / "metrics.json").read_text())["full"]["aggressive"]
    assert cell["vacuous"] and cell["starts"] == 0
    assert cell["success"] is cell["constant_detour_baseline"] is cell["oracle"] is None


def test_the_same_inputs_give_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    repeats_itself(main, cfg, out, tmp_path)


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "full", tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("repair.steps", 0, "repair.steps is 0"),
        ("repair.starts", 0, "repair.starts is 0"),
        ("repair.split", "seen_scenes", "expected a split that all seeds share, one of new_scenes, new_items"),
        ("repair.split", "new_scenes", "no scenes new_scenes"),
        ("repair.optimiser", "newton", "expected one of gradient"),
    ],
)
def test_settings_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value, message: str):
    refuses(main, cfg, name, value, message, tmp_path / "out")
