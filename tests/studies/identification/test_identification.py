"""The identify stage: the same paths for everyone, the truth as the ceiling, and a stranger set by its margins."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_json, read_table, write_arrays
from studies.identification.stage import main
from tests.stages.facts import names_a_missing_model, refuses, repeats_itself
from tests.stages.inputs import SCENES, untrained_models

PATHS = 6
KEPT = ["curve.csv", "metrics.json"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Three scenes; models that say the same of every user; users whose mean validity by position differs."""
    cfg = untrained_models(tmp_path_factory.mktemp("inputs"), [0, 1])
    cfg.identify.update(paths=PATHS, draws=4, reported=[1, 5])
    prior = {user: np.full((2, 2), p) for user, p in zip(cfg.users, (0.4, 0.7, 1.0), strict=True)}
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", prior)
    return cfg


@pytest.fixture(scope="module")
def out(cfg: DictConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("out")
    main(cfg, directory)
    return directory


def test_every_observer_is_judged_after_every_path(cfg: DictConfig, out: Path):
    curve, metrics = read_table(out / "curve.csv"), read_json(out / "metrics.json")
    observers = [*cfg.variants, "position_only"]
    assert list(curve["variant"].unique()) == observers
    assert (curve.groupby("variant")["k"].apply(list).map(lambda k: k == [*range(1, PATHS + 1)])).all()
    assert set(metrics["identification"]) == set(metrics["open_set"]) == set(metrics["largest_gap"]) == {*observers}
    assert set(metrics["passes_99"]) == {*observers, "ideal"}
    assert set(metrics["identification"]["path"]) == {"k1", "k5"}
    assert (metrics["seeds"], metrics["scenes"], metrics["draws"]) == (2, SCENES, 4)
    assert metrics["floor"] == pytest.approx(1 / (20 * 9 + 2), abs=1e-6)


def test_models_that_do_not_differ_between_users_are_at_chance(out: Path):
    metrics, curve = read_json(out / "metrics.json"), read_table(out / "curve.csv")
    models = curve[curve["variant"] != "position_only"]
    np.testing.assert_allclose(models[["accuracy", "confidence"]], 1 / 3, atol=1e-6)
    assert metrics["chance"] == pytest.approx(1 / 3, abs=1e-6)


def test_nobody_is_right_more_often_than_one_who_was_told_the_truth(out: Path):
    curve = read_table(out / "curve.csv")
    assert (curve["accuracy"] <= curve["ideal_accuracy"] + 1e-6).all()
    assert (curve["ideal_false_alarms"] == 0).all()
    assert (curve.groupby("variant")["ideal_accuracy"].diff().dropna() >= -1e-6).all()


def test_the_metrics_say_what_the_curve_says(out: Path):
    metrics, curve = read_json(out / "metrics.json"), read_table(out / "curve.csv")
    row = curve[(curve["variant"] == "position_only") & (curve["k"] == 5)].iloc[0]
    cell, opened = metrics["identification"]["position_only"]["k5"], metrics["open_set"]["position_only"]["k5"]
    names = {"mean": "accuracy", "ci_low": "accuracy_low", "ci_high": "accuracy_high", "ideal": "ideal_accuracy"}
    for name, column in names.items():
        assert cell[name] == pytest.approx(row[column], abs=1e-5)
    assert np.mean([*cell["users"].values()]) == pytest.approx(cell["mean"], abs=1e-5)
    assert np.mean([*cell["ideal_users"].values()]) == pytest.approx(cell["ideal"], abs=1e-5)
    assert np.mean([*opened["users"].values()]) == pytest.approx(opened["false_alarms"], abs=1e-5)


def test_a_stranger_with_a_known_user_s_margins_passes_for_that_user(cfg: DictConfig, tmp_path: Path):
    same = cfg.copy()
    same.identify.stranger = cfg.users.careful
    main(same, tmp_path)
    metrics = read_json(tmp_path / "metrics.json")
    for by_k in metrics["open_set"].values():
        for cell in by_k.values():
            assert cell["ideal_recognised"] == 0
            assert cell["recognised"] == cell["users"]["careful"]


def test_the_stranger_changes_nothing_for_the_known_users(cfg: DictConfig, out: Path, tmp_path: Path):
    other = cfg.copy()
    other.identify.stranger.update(bowl=0.1, glass=0.0)
    main(other, tmp_path)
    columns = ["accuracy", "false_alarms", "confidence"]
    before, after = (read_table(d / "curve.csv")[columns] for d in (out, tmp_path))
    pd.testing.assert_frame_equal(before, after)


def test_a_second_run_and_more_workers_write_the_same_bytes(cfg: DictConfig, out: Path, tmp_path: Path):
    assert sorted(p.name for p in out.iterdir()) == KEPT
    repeats_itself(main, cfg, out, tmp_path, workers=2)


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "irl_ranked", tmp_path / "out")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("paths", 0, "identify.paths is 0: expected a whole number from 1"),
        ("draws", True, "identify.draws is True"),
        ("reported", [1, PATHS + 1], f"whole numbers from 1 to {PATHS}"),
        ("level", 1.0, "identify.level is 1.0: expected a number between 0 and 1"),
        ("stranger", {"plate": 0.045}, "a margin for each of bowl, plate, cutlery, glass"),
        (
            "stranger",
            dict.fromkeys(("bowl", "plate", "cutlery", "glass"), -1.0),
            "identify.stranger.bowl is -1.0: expected null .* or a margin from 0 to 1",
        ),
        ("split", "seen_scenes", "expected a split that all seeds share, one of new_scenes, new_items"),
    ],
)
def test_settings_out_of_range_are_refused(cfg: DictConfig, tmp_path: Path, name: str, value, message: str):
    refuses(main, cfg, f"identify.{name}", value, message, tmp_path / "out")
