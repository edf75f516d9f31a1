"""The self-test stage draws families anew from the measured effects."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.files import write_table
from pipeline.params import compose
from pipeline.stages.selftest import main
from pipeline.table.layout import SYMBOLS
from tests.stages.facts import refuses, repeats_itself

BY_SCENE = 0.1


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Effects of every variant that differ by scene alone, and of which none is the true one of a glass."""
    cfg = compose(["profile=smoke", "workers=1", f"paths.intervene={tmp_path_factory.mktemp('intervene')}"])
    OmegaConf.set_struct(cfg, False)
    keys = product(cfg.variants, cfg.seeds, cfg.users, SYMBOLS, range(200), [0, 1])
    rows = pd.DataFrame(list(keys), columns=["variant", "seed", "user", "symbol", "scene", "placement"])
    by_scene = np.random.default_rng(0).normal(0, BY_SCENE, 200)
    effect = by_scene[rows["scene"]] + np.where(rows["placement"] == 0, 0.01, -0.01)
    rows = rows.assign(effect=effect, true_effect=np.where(rows["symbol"] == "glass", 0.3, 0.0))
    write_table(Path(cfg.paths.intervene) / "effects.parquet", rows.sample(frac=1, random_state=0))
    return cfg


def test_effects_measured_before_a_user_came_are_told_to_be_old(cfg: DictConfig, tmp_path: Path):
    message = "lacks full of newcomer: run the intervene stage again"
    refuses(main, cfg, "users.newcomer", dict(cfg.users.normal), message, tmp_path / "out")


def test_the_regime_of_a_variant_is_that_of_its_effects(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path)
    found = json.loads((tmp_path / "metrics.json").read_text())
    assert (found["seeds"], found["scenes"], found["families"]) == (2, 200, 20)
    assert found["measured"] == list(cfg.variants)
    assert set(found["regimes"]) == {*cfg.variants, *cfg.selftest.stylised}
    path = found["regimes"]["path"]
    assert path["by_scene"] == pytest.approx(BY_SCENE, rel=0.15)
    assert path["by_seed"] == pytest.approx(0, abs=1e-9) and path["rest"] == pytest.approx(0, abs=1e-9)
    assert set(path["power"]) == {str(effect) for effect in cfg.selftest.effects}


def test_what_could_be_detected_and_what_single_seeds_say_stands_for_every_variant(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path)
    found = json.loads((tmp_path / "metrics.json").read_text())["precision"]
    assert set(found) == set(cfg.variants)
    each = len(cfg.users) * len(cfg.seeds)  # verdicts on a symbol: "no effect", which is wrong of glasses alone
    assert found["path"]["seed_by_seed"] == {"right": each * (len(SYMBOLS) - 1), "of": each * len(SYMBOLS)}
    cell = found["path"]["cells"]["careful"]["glass"]
    assert cell["detectable"] == pytest.approx(0.05 + 0.1 / 200**0.5 * 0.843, rel=0.02)  # Student's t, power .8
    assert all(5 < c["scenes"] < 50 for by_symbol in found["path"]["cells"].values() for c in by_symbol.values())


def test_a_second_run_and_more_workers_write_the_same_bytes(cfg: DictConfig, tmp_path: Path):
    main(cfg, tmp_path / "one")
    repeats_itself(main, cfg, tmp_path / "one", tmp_path / "two", workers=2)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("selftest.families", 0, "selftest.families is 0"),
        ("selftest.effects", [], r"selftest.effects is \[\]: expected one at least"),
        ("selftest.cells", 2, "selftest.cells is 2: expected at least the 8 cells"),
    ],
)
def test_settings_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value, message: str):
    refuses(main, cfg, name, value, message, tmp_path / "out")
