"""Repairs are tables and paths that agree, from starts that are invalid to their user."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig
from pipeline.artifacts.repairs import draw_starts, rows

from pipeline.artifacts.scenes import SceneSet, read_scenes
from pipeline.runtime.errors import InputError
from pipeline.world.rules import valid
from tests.factories import untrained_models


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    cfg = untrained_models(tmp_path_factory.mktemp("inputs"), [0])
    cfg.paths.repair = str(tmp_path_factory.mktemp("repair"))
    return cfg


@pytest.fixture(scope="module")
def scenes(cfg: DictConfig) -> SceneSet:
    return read_scenes(Path(cfg.paths.scenes))


def test_starts_are_all_candidates_that_are_invalid_to_the_user_and_one_is_needed(cfg: DictConfig, scenes: SceneSet):
    candidates, starts = draw_starts(cfg, scenes)
    for user, s in starts.items():
        truth = valid(scenes.layouts["new_items"], candidates, cfg.users[user])
        assert len(s.z) == (~truth).sum() and not truth[s.scene, s.start].any()
        np.testing.assert_array_equal(s.z, candidates[s.scene, s.start])
    content = cfg.copy()
    content.users = {"aggressive": cfg.users.aggressive}  # all paths are valid to
    with pytest.raises(InputError, match=r"raise repair\.starts"):
        draw_starts(content, scenes)


def test_only_ends_that_a_model_accepts_are_accepted(cfg: DictConfig, scenes: SceneSet):
    s = draw_starts(cfg, scenes)[1]["careful"]
    p = np.linspace(0, 1, len(s.z))
    table = rows(s, "gradient", "full", 0, s.nearest, p, p)
    assert (table["accepted"] == (p > 0.5)).all()
    assert table["valid_end"].all() and (table["displacement_m"] == table["oracle_displacement_m"]).all()
    baseline = rows(s, "oracle", "", 0, s.nearest)
    assert baseline[["accepted", "p_start", "p_end"]].isna().all(axis=None)
