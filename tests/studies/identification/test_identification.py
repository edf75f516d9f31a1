"""Everyone sees the same paths, the ideal observer is the ceiling, and a stranger is set by its margins."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_arrays
from studies.identification.stage import main
from tests.factories import untrained_models
from tests.stages.facts import names_a_missing_model

PATHS = 6


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Three scenes; models that say the same of every user; users whose mean validity by position differs."""
    cfg = untrained_models(tmp_path_factory.mktemp("inputs"), [0, 1])
    cfg.studies.identification.update(paths=PATHS, draws=4, reported=[1, 5])
    prior = {user: np.full((2, 2), p) for user, p in zip(cfg.users, (0.4, 0.7, 1.0), strict=True)}
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", prior)
    return cfg


def test_models_that_do_not_differ_between_users_are_at_chance(out: Path):
    curve = read_table(out / "curve.csv")
    models = curve[~curve["variant"].isin(["position_only", "ideal"])]
    np.testing.assert_allclose(models[["accuracy", "confidence"]], 1 / 3, atol=1e-5)


def test_nobody_beats_the_ideal_observer(out: Path):
    curve = read_table(out / "curve.csv").query("user == 'all'")
    ideal = curve[curve["variant"] == "ideal"].set_index("k")["accuracy"]
    assert (curve["accuracy"] <= curve["k"].map(ideal) + 1e-5).all()
    assert ideal.is_monotonic_increasing
    alarms = read_table(out / "open_set.csv").query("variant == 'ideal' and user != 'stranger'")
    assert (alarms["rejected"] == 0).all()


def test_the_stranger_passes_for_the_user_of_its_margins_and_changes_no_answer_for_others(
    cfg: DictConfig, tmp_path: Path, out: Path
):
    same = cfg.copy()
    same.studies.identification.stranger = cfg.users.careful
    main(same, tmp_path)
    rejected = read_table(tmp_path / "open_set.csv").pivot(index=["variant", "k"], columns="user", values="rejected")
    assert (rejected["stranger"] == rejected["careful"]).all()
    other = cfg.copy()
    other.studies.identification.stranger.update(bowl=0.1, glass=0.0)
    main(other, tmp_path)
    for name in ("curve.csv", "open_set.csv"):
        before, after = (read_table(d / name).query("user != 'stranger'") for d in (out, tmp_path))
        pd.testing.assert_frame_equal(before, after)


def test_a_missing_model_is_named_before_any_work(cfg: DictConfig, tmp_path: Path):
    names_a_missing_model(main, cfg, "irl_ranked", tmp_path / "out")
