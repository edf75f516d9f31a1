"""The stage fits the path model without one ingredient at a time, where choices are made and nowhere else."""

from pathlib import Path

import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_json
from pipeline.params import compose
from pipeline.spec.ablations import ABLATIONS
from pipeline.stages import ablate, demos, scenes
from tests.stages.facts import refuses, repeats_itself
from tests.stages.inputs import SMALL_WORLD


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """A small world with two validation seeds, as the stages write it."""
    root = tmp_path_factory.mktemp("ablate")
    few = ["path.steps=3", "scenes.per_seed=3", "validation_seeds=[100,101]", "scenes.validation=2"]
    cfg = compose([*SMALL_WORLD, *few, *(f"paths.{s}={root / s}" for s in ("scenes", "demos"))])
    for stage in (scenes, demos):
        stage.main(cfg, root / stage.__name__.rsplit(".", 1)[-1])
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    ablate.main(cfg, directory)
    return directory


def test_every_ingredient_has_its_numbers_beside_the_whole_model(cfg: DictConfig, out: Path):
    found = read_json(out / "metrics.json")
    assert found["order"] == list(ABLATIONS) and set(found["ablations"]) == set(ABLATIONS)
    assert (found["seeds"], found["pools"], found["users"]) == (2, ["val_scenes", "val_items"], ["careful", "normal"])
    whole = found["ablations"]["whole"]
    for name, cells in found["ablations"].items():
        assert set(cells) == {"n1", "n9"}
        for n, cell in cells.items():
            assert 0 <= cell["ece"] <= 1
            assert cell["change_low"] <= cell["change"] <= cell["change_high"]
            assert cell["accuracy"] - cell["change"] == pytest.approx(whole[n]["accuracy"], abs=2e-6)
            assert name != "whole" or cell["change"] == 0


def test_extremes_are_of_seeds_not_of_users(cfg: DictConfig, tmp_path: Path):
    alone = cfg.copy()
    alone.validation_seeds = [100]
    ablate.main(alone, tmp_path)
    for cells in read_json(tmp_path / "metrics.json")["ablations"].values():
        for cell in cells.values():
            assert cell["change_low"] == cell["change"] == cell["change_high"]


def test_missing_training_scenes_are_named(cfg: DictConfig, tmp_path: Path):
    refuses(ablate.main, cfg, "validation_seeds", [100, 107], "no scenes train-s107", tmp_path / "out")


def test_a_second_run_by_two_processes_writes_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    repeats_itself(ablate.main, cfg, out, tmp_path, workers=2)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("variant", "full", "expected one of path"),
        ("n", [2], "expected some of 1, 9"),
        ("n", [], "ablate.n"),
        ("pools", ["new_items"], "expected pools of validation, some of val_scenes, val_items"),
        ("pools", [], "ablate.pools"),
    ],
)
def test_settings_out_of_range_are_refused_before_any_work(cfg: DictConfig, tmp_path: Path, name, value, message):
    refuses(ablate.main, cfg, f"ablate.{name}", value, message, tmp_path / "out")
