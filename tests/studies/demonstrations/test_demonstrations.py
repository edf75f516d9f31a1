"""Demonstrations of every kind are what they are said to be, and judge models by paths that were not shown."""

from pathlib import Path

import numpy as np
import pytest
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table, write_arrays
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.models.baselines import NEAREST
from pipeline.params import compose
from pipeline.training.judged_sets import FEW, HELD_OUT, NEW, OWN
from pipeline.world.rules import clearance, slack
from studies.demonstrations import stage
from studies.demonstrations.stage import show_all
from tests.factories import rendered_scenes

main = stage.main  # of the fixture `out`
TRAINING, NEW_SCENES = 4, 3
SMALL = ["profile=smoke", "workers=1", "train.steps=2", "clearance.steps=2", "readings.candidates=400"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' training scenes, and new ones."""
    cfg = compose([*SMALL, f"paths.scenes={tmp_path_factory.mktemp('demonstrations')}"])
    training = {train_pool(seed): (TRAINING, "train") for seed in cfg.seeds}
    rendered_scenes(cfg, training | {"val_scenes": (NEW_SCENES, "train")})
    prior = {user: np.full((2, 2), 0.4) for user in cfg.evaluate.users}
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", prior)
    return cfg


def test_labels_are_true_and_no_judged_path_was_shown(cfg: DictConfig):
    scenes, families = read_scenes(Path(cfg.paths.scenes)), np.array(cfg.readings.families)
    shown = list(show_all(cfg, scenes))
    assert len(shown) == 2 * 2 * 2 * 2, "routes, distances, seeds, users"
    for x in shown:
        for split, (z, valid) in x.judged.items():
            layouts = scenes.layouts["val_scenes" if split == NEW else train_pool(x.seed)]
            np.testing.assert_array_equal(slack(layouts, clearance(layouts, z), cfg.users[x.user]) > 0, valid)
            if x.routes == FEW:
                far = np.linalg.norm(z[:, :, None] - families, axis=-1).min(-1)
                assert far.max() <= cfg.readings.family_radius + 1e-9
        demos, held_out = (x.judged[split][0] for split in (OWN, HELD_OUT))
        assert x.z_theta is demos or (x.z_theta == demos).all()
        assert np.linalg.norm(demos[:, :, None] - held_out[:, None], axis=-1).min() > 0


def test_every_kind_is_judged_and_the_nearest_demonstration_leads_itself_by_nothing(cfg: DictConfig, out: Path):
    study, summary = cfg.studies.demonstrations, read_table(out / "summary.csv")
    kinds = 2 * len(study.clear_cm)
    expected = kinds * (3 * len(study.seeds) + 3 + 1)  # three splits of each variant and of position only
    assert len(summary) == expected and summary["accuracy"].between(0, 1).all()
    assert (summary.query(f"variant == '{NEAREST}'")[["lead", "lead_q1", "lead_q3"]] == 0).all(axis=None)
    full = summary.query(f"variant == 'full' and split == '{HELD_OUT}'").set_index(["routes", "clear_cm"])["accuracy"]
    nearest = summary.query(f"variant == '{NEAREST}'").set_index(["routes", "clear_cm"])["accuracy"]
    lead = summary.query(f"variant == 'full' and split == '{HELD_OUT}'").set_index(["routes", "clear_cm"])["lead"]
    np.testing.assert_allclose(full - nearest, lead, atol=2e-6)
    examples = read_arrays(out / "examples.npz")
    assert len(examples["names"]) == kinds and examples["z_theta"].shape == (kinds, cfg.main_n_demos, 2)
