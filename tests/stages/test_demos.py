"""Stage demos: complete, labelled by the lines that hands drew."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig, OmegaConf

from pipeline.artifacts.demos import DEMO_KEY, demo_arrays, read_demos, read_queries, read_trajectories
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


def test_every_seed_user_and_scene_has_its_demonstrations_and_careful_users_accept_least(out: Path):
    assert {path.name for path in out.iterdir()} == {"demos.parquet", "trajectories.npz", "queries.npz"}
    demos = read_demos(out)
    assert len(demos) == 3 * 3 * 3 * 10 and not demos.duplicated(DEMO_KEY).any()
    share = demos.groupby("user")["valid"].mean()
    assert 0 < share["careful"] < share["normal"] < share["aggressive"] == 1.0


def test_labels_are_of_the_lines_that_hands_drew_and_not_of_the_fitted_paths(cfg: DictConfig, tmp_path: Path):
    shaky = with_value(cfg.copy(), "demos.hand.drift_m=0.008")
    main(shaky, tmp_path)
    assert 0.8 < fits_that_agree(shaky, tmp_path) < 1


def fits_that_agree(cfg: DictConfig, out: Path) -> float:
    """The share of fitted paths with the label of their line; every label is its line's."""
    demos, recordings = read_demos(out), read_trajectories(out)
    scenes, of_fits = read_scenes(Path(cfg.paths.scenes)), []
    for (seed, user), rows in demos.groupby(["seed", "user"]):  # pyright: ignore
        layouts, first, last = scenes.layouts[train_pool(seed)], rows.index[0], rows.index[-1] + 1
        samples = recordings[0][recordings[1][first] : recordings[1][last]].astype(float)
        offsets = recordings[1][first : last + 1] - recordings[1][first]
        of_lines = valid_trajectories(layouts, samples, offsets, dict(cfg.users[user])).ravel()
        np.testing.assert_array_equal(rows["valid"].to_numpy(), of_lines)
        z, _ = demo_arrays(demos, seed, user, cfg.demos.per_scene)
        of_fits += list(valid(layouts, z, dict(cfg.users[user])).ravel() == of_lines)
    return float(np.mean(of_fits))


def test_queries_are_labelled_by_the_truth_and_unseen_by_training(cfg: DictConfig, out: Path):
    scenes, queries = read_scenes(Path(cfg.paths.scenes)), read_queries(out)
    assert set(queries) == set(SCENES)
    assert queries["train-s0"].z.shape == (3, cfg.demos.queries_seen, 2)
    assert queries["new_items"].z.shape == (4, cfg.demos.queries_new, 2)
    for pool, q in queries.items():
        for user, margins in cfg.users.items():
            np.testing.assert_array_equal(q.valid[user], valid(scenes.layouts[pool], q.z, dict(margins)))
    seen = read_demos(out)[["z_x", "z_y"]].to_numpy()
    paths = queries["train-s0"].z.reshape(-1, 2)
    assert np.linalg.norm(seen[:, None] - paths, axis=-1).min() > 0
