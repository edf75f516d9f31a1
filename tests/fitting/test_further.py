"""Further training scenes follow a seed's own ones and look alike; demonstrations there follow the users' rules."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.demos import demo_arrays, read_demos
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool
from pipeline.errors import InputError
from pipeline.fitting.further import demonstrations, further_scenes, taught
from pipeline.params import compose
from pipeline.stages import demos, scenes
from pipeline.table.items import read_catalogue
from pipeline.table.layout import Layouts
from pipeline.table.rules import valid
from tests.stages.inputs import SMALL_WORLD

OWN, MORE = 4, 6


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' scenes and demonstrations, as the stages write them."""
    root = tmp_path_factory.mktemp("further")
    cfg = compose([*SMALL_WORLD, f"scenes.per_seed={OWN}", *(f"paths.{s}={root / s}" for s in ("scenes", "demos"))])
    for stage in (scenes, demos):
        stage.main(cfg, root / stage.__name__.rsplit(".", 1)[-1])
    return cfg


@pytest.fixture(scope="module")
def read(cfg: DictConfig) -> tuple[SceneSet, pd.DataFrame]:
    return read_scenes(Path(cfg.paths.scenes)), read_demos(Path(cfg.paths.demos))


@pytest.fixture(scope="module")
def drawn(cfg: DictConfig) -> tuple[Layouts, np.ndarray]:
    return further_scenes(cfg, 0, 30)


def test_a_seed_s_own_scenes_come_first_with_their_own_demonstrations(cfg: DictConfig, read):
    found, table = read
    for lesson, user in zip(taught(cfg, found, table, 1, OWN + MORE), cfg.evaluate.users, strict=True):
        assert (lesson.user, lesson.seed, len(lesson.images)) == (user, 1, OWN + MORE)
        assert lesson.z_theta.shape == (OWN + MORE, cfg.study_n, 2) and lesson.valid.shape == (OWN + MORE, cfg.study_n)
        z, labels = demo_arrays(table, 1, user, cfg.study_n)
        np.testing.assert_array_equal(lesson.images[:OWN], found.images[train_pool(1)])
        np.testing.assert_array_equal(lesson.z_theta[:OWN], z)
        np.testing.assert_array_equal(lesson.valid[:OWN], labels)


def test_no_further_scene_is_drawn_where_a_seed_s_own_ones_are_enough(cfg: DictConfig, read):
    found, table = read
    assert {len(lesson.images) for lesson in taught(cfg, found, table, 0, 2)} == {OWN}


def test_asking_for_more_leaves_the_first_ones_as_they_are(cfg: DictConfig, drawn):
    layouts, images = drawn
    few, pictures = further_scenes(cfg, 0, 3)
    np.testing.assert_array_equal(pictures, images[:3])
    np.testing.assert_array_equal(few.centre, layouts.centre[:3])
    z, labels = demonstrations(cfg, few, "careful", 0)
    more_z, more_labels = demonstrations(cfg, layouts, "careful", 0)
    np.testing.assert_array_equal(z, more_z[:3])
    np.testing.assert_array_equal(labels, more_labels[:3])


def test_other_seeds_have_other_scenes_and_other_demonstrations(cfg: DictConfig, drawn):
    layouts, images = drawn
    assert not (further_scenes(cfg, 1, 30)[1] == images).all((1, 2, 3)).any()
    assert not (demonstrations(cfg, layouts, "careful", 0)[0] == demonstrations(cfg, layouts, "careful", 1)[0]).any()


def test_only_training_items_stand_there(cfg: DictConfig, drawn):
    layouts, _ = drawn
    allowed = read_catalogue(Path(cfg.paths.data)).pool("train")
    assert np.isin(layouts.item[layouts.present], allowed).all()
    assert set(layouts.present.sum(1)) == set(cfg.scenes.layout.items_per_scene)


def test_labels_are_the_truth_of_the_recorded_line_and_all_but_always_of_the_fitted_path(cfg: DictConfig, drawn):
    layouts, _ = drawn
    share = {}
    for user, margins in cfg.users.items():
        z, labels = demonstrations(cfg, layouts, user, 0)
        assert (labels == valid(layouts, z, dict(margins))).mean() > 0.95
        share[user] = labels.mean()
    assert 0 < share["careful"] < share["normal"] < share["aggressive"] == 1


def test_scenes_and_demonstrations_of_another_number_are_refused(cfg: DictConfig, read):
    found, table = read
    changed = cfg.copy()
    changed.scenes.per_seed = OWN + 1
    with pytest.raises(InputError, match=r"train-s0 has not the 5 scenes of scenes\.per_seed"):
        taught(changed, found, table, 0, OWN)
    with pytest.raises(InputError, match="demonstrations of careful are not of train-s0's 4 scenes"):
        taught(cfg, found, table[table["scene"] > 0], 0, OWN)
