"""Stage demos: complete, labelled by the lines that hands drew."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import demo_arrays, read_demos, read_trajectories
from pipeline.artifacts.scenes import SceneSet, read_scenes, train_pool, write_scenes
from pipeline.stages.demos import main
from pipeline.world.hand import valid_trajectories
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import valid
from tests.factories import appearances, composed, with_value

pytestmark = pytest.mark.slow  # every test runs the stage
SCENES = {"train-s0": 3, "train-s1": 3, "train-s100": 3, "new_scenes": 4, "new_items": 4}


def layouts(rng: np.random.Generator, scenes: int) -> Layouts:
    """Two round items a scene, of any symbol."""
    shape = (scenes, 2)
    zero, symbol = np.zeros(shape), rng.integers(len(SYMBOLS), size=shape)
    return Layouts(symbol, symbol, rng.uniform(0.3, 0.7, (*shape, 2)), zero, zero + 1.0, zero, zero + 0.05)


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    cfg, folder = composed("profile=smoke"), tmp_path_factory.mktemp("scenes")
    OmegaConf.update(cfg, "paths.scenes", str(folder))
    rng = np.random.default_rng(0)
    blank = {pool: np.zeros((n, 100, 100, 3), np.uint8) for pool, n in SCENES.items()}
    appearance = {pool: appearances(n) for pool, n in SCENES.items()}
    write_scenes(folder, SceneSet(blank, {p: layouts(rng, n) for p, n in SCENES.items()}, appearance))
    return cfg


def test_labels_are_of_the_lines_that_hands_drew_and_not_of_the_fitted_paths(cfg: DictConfig, tmp_path: Path):
    main(with_value(cfg.copy(), "demos.hand.drift_m=0.008"), tmp_path)
    demos, recordings = read_demos(tmp_path), read_trajectories(tmp_path)
    scenes, of_fits = read_scenes(Path(cfg.paths.scenes)), []
    for (seed, user), rows in demos.groupby(["seed", "user"]):  # pyright: ignore
        layouts, first, last = scenes.layouts[train_pool(seed)], rows.index[0], rows.index[-1] + 1
        samples = recordings[0][recordings[1][first] : recordings[1][last]].astype(float)
        offsets = recordings[1][first : last + 1] - recordings[1][first]
        of_lines = valid_trajectories(layouts, samples, offsets, dict(cfg.users[user])).ravel()
        np.testing.assert_array_equal(rows["valid"].to_numpy(), of_lines)
        z, _ = demo_arrays(demos, seed, user, cfg.demos.per_scene)
        of_fits += list(valid(layouts, z, dict(cfg.users[user])).ravel() == of_lines)
    assert 0.8 < np.mean(of_fits) < 1
