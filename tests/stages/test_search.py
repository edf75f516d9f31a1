"""The search stage: every model and rival from the same invalid starts, and the truth beside them."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table
from pipeline.artifacts.repairs import draw_starts
from pipeline.artifacts.scenes import read_scenes
from pipeline.errors import InputError
from pipeline.stages.search import main, told
from pipeline.table.bezier import random_z_theta
from pipeline.table.layout import SYMBOLS, random_layouts
from pipeline.table.rules import clearance, slack
from tests.examples import RULES
from tests.stages.facts import names_a_missing_model, refuses, repeats_itself
from tests.stages.inputs import ITEMS, untrained_models


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    return untrained_models(tmp_path_factory.mktemp("inputs"), [0, 1])


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("search")
    main(cfg, out)
    return out


def test_every_model_searches_from_the_same_starts_and_the_path_model_by_every_method(out: Path):
    table = read_table(out / "searches.parquet")
    assert set(table["user"]) == {"careful", "normal"}
    for _, of_user in table.groupby("user"):
        own = of_user[of_user["search"] == "bayesian"]
        key = ["scene", "start", "z0_x", "z0_y", "oracle_displacement_m"]
        starts = [part[key].to_numpy() for _, part in own.groupby(["method", "seed"])]
        assert len(starts) == 3 * 2 + 1  # three variants of two seeds, and the truth
        for other in starts[1:]:
            np.testing.assert_array_equal(starts[0], other)
        assert set(of_user.loc[of_user["method"] == "path", "search"]) == {"bayesian", "multistart", "cem", "lbfgs"}
        assert (of_user[of_user["search"] == "lbfgs"].groupby("seed").size() == 2).all()


def test_models_that_are_the_same_sample_anew_for_every_seed_but_look_alike(out: Path):
    table = read_table(out / "searches.parquet").query("method == 'path'")
    for user, method in product(("careful", "normal"), ("bayesian", "cem")):
        rows = table[(table["user"] == user) & (table["search"] == method)]
        one, other = (rows.loc[rows["seed"] == seed, ["z_x", "z_y"]].to_numpy() for seed in (0, 1))
        assert np.array_equal(one, other) == (method == "bayesian")


def test_who_is_told_the_truth_succeeds_nearly_always_and_moves_little(out: Path):
    cells = json.loads((out / "metrics.json").read_text())["truth"]
    for user in ("careful", "normal"):
        assert cells[user]["bayesian"]["success"] > 0.9
        assert cells[user]["bayesian"]["displacement_ratio"] < 2


def test_the_told_model_calls_valid_what_the_rules_call_valid(cfg: DictConfig):
    rng = np.random.default_rng(1)
    layouts = random_layouts(rng, 20, ITEMS, np.arange(4), RULES)
    z = random_z_theta(rng, 20, 50)
    for user in ("careful", "normal", "aggressive"):
        model, percept = told(layouts, cfg.users[user])
        with torch.no_grad():
            log_odds = model.logit(percept, torch.tensor(z).float()).numpy()
        room = slack(layouts, clearance(layouts, z), cfg.users[user])
        clear = np.abs(room) > 0.003
        assert ((log_odds > 0) == (room > 0))[clear].all()


def test_correct_fooled_and_abstained_share_out_all_starts(out: Path):
    table = read_table(out / "searches.parquet")
    cell = json.loads((out / "metrics.json").read_text())["path"]["careful"]["bayesian"]
    assert cell["correct"] + cell["fooled"] + cell["abstained"] == pytest.approx(1)
    assert cell["seeds"] == 2
    rows = table.query("method == 'path' and user == 'careful' and search == 'bayesian'")
    assert cell["success"] == pytest.approx(rows.groupby("seed")["valid_end"].mean().mean())


def test_the_same_inputs_give_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    repeats_itself(main, cfg, out, tmp_path)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        (
            "search.rivals",
            {"newton": None},
            "a name in search.rivals is 'newton': expected 'multistart', 'cem' or 'lbfgs'",
        ),
        ("search.rivals_of", "fulll", "search.rivals_of is 'fulll'"),
        ("search.climb", 20, r"search.looks \+ search.climb is 31"),
        ("repair.starts", 0, "repair.starts is 0"),
    ],
)
def test_settings_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value, message: str):
    refuses(main, cfg, name, value, message, tmp_path / "out")


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "full", tmp_path / "out")


def test_where_no_path_is_invalid_there_is_nothing_to_begin_with(cfg: DictConfig):
    calm = cfg.copy()
    calm.users = {user: dict.fromkeys(SYMBOLS) for user in cfg.users}
    with pytest.raises(InputError, match="no user has an invalid path among those drawn in new_items: raise repair"):
        draw_starts(calm, read_scenes(Path(cfg.paths.scenes)))
