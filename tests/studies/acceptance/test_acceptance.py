"""The study fits models to some scenes, calibrates them in the others, and counts the invalid paths accepted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_table, write_arrays
from pipeline.artifacts.scenes import read_scenes, train_pool, write_scenes
from pipeline.params import compose
from pipeline.runtime.errors import InputError
from studies.acceptance import stage
from studies.acceptance.stage import main
from tests.factories import labelled_demos, labelled_queries, rendered_scenes

pytestmark = pytest.mark.slow
TRAINING, SCENES, PATHS, LEVEL = 4, 5, 12, 0.1
SMALL = ["profile=smoke", "workers=1", f"scenes.per_seed={TRAINING}", "train.steps=2", "clearance.steps=2"]
SMALL += ["train.engine=reference", "studies.acceptance.variants=[full,clearance]", "studies.acceptance.fitted=1"]
SMALL += [f"studies.acceptance.level={LEVEL}"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' training scenes with demonstrations, and new scenes with paths to be judged."""
    root = tmp_path_factory.mktemp("acceptance")
    cfg = compose([*SMALL, *(f"paths.{name}={root / name}" for name in ("scenes", "demos"))])
    training = {train_pool(seed): (TRAINING, "train") for seed in cfg.seeds}
    scenes = rendered_scenes(cfg, training | {"new_scenes": (SCENES, "train"), "new_items": (SCENES, "unseen")})
    labelled_demos(cfg, scenes)
    labelled_queries(cfg, scenes, ["new_scenes", "new_items"], PATHS)
    prior = {user: np.full((2, 2), 0.7) for user in cfg.evaluate.users}
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", prior)
    return cfg


def test_a_model_that_accepts_no_path_accepts_none_that_is_invalid(out: Path):
    summary = read_table(out / "summary.csv")
    silent = summary[summary["abstained"] == summary["models"]]
    assert len(silent) and (silent[["invalid", "power", "accepted"]] == 0).all(axis=None)
    accepting = summary["models"] - summary["abstained"]
    total = (summary["invalid_where_any"].fillna(0) * accepting).to_numpy()
    np.testing.assert_allclose(total, summary["invalid"] * summary["models"], atol=1e-4)


def test_27_demonstrations_are_too_few_to_promise_two_per_cent(out: Path):
    strict = read_table(out / "curve.csv").query("rule == 'conformal' and level <= 0.02")
    assert len(strict) == 3 * 2 * 2 and (strict["abstained"] == 1).all() and (strict["power"] == 0).all()


def test_a_weaker_promise_accepts_more_and_the_threshold_ignores_it(cfg: DictConfig, out: Path):
    curve, summary = read_table(out / "curve.csv"), read_table(out / "summary.csv").query("user == 'all'")
    key = ["variant", "split", "rule"]
    for (_, _, rule), rows in curve.groupby(key):
        assert list(rows["level"]) == list(cfg.studies.acceptance.levels)
        assert rows["power"].is_monotonic_increasing
        assert rule == stage.CONFORMAL or rows["power"].nunique() == 1
    promised = curve[curve["level"] == LEVEL].set_index(key)
    for column in ("invalid", "power"):
        np.testing.assert_allclose(promised[column], summary.set_index(key).loc[promised.index, column], atol=1e-5)


def test_another_number_of_training_scenes_is_refused(cfg: DictConfig, tmp_path: Path):
    changed, scenes = cfg.copy(), read_scenes(Path(cfg.paths.scenes))
    changed.paths.scenes = str(tmp_path / "scenes")
    pool = train_pool(cfg.seeds[0])
    fewer = {name: part | {pool: part[pool][:3]} for name, part in vars(scenes).items()}
    write_scenes(tmp_path / "scenes", replace(scenes, **fewer))
    with pytest.raises(InputError, match=f"3 scenes {pool}: expected 4"):
        main(changed, tmp_path / "out")
