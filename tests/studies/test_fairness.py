"""A learner reads the true code, and is judged by paths that it was not shown."""

from pathlib import Path

import numpy as np
import pytest
import torch
from omegaconf import DictConfig

from pipeline.artifacts.files import write_arrays
from pipeline.artifacts.scenes import read_scenes, train_pool
from pipeline.params import compose
from pipeline.training.judged_sets import FEW, HELD_OUT, NEW, OWN, ROUTES, draw_judged_sets
from pipeline.world.layout import EMPTY, SYMBOLS, random_layouts
from pipeline.world.rules import clearance, slack
from studies.fairness.stage import JointVae, true_code
from tests.factories import ITEMS, RULES, rendered_scenes

SMALL = ["profile=smoke", "workers=1", "train.steps=2", "readings.candidates=400"]


@pytest.fixture(scope="module")
def cfg(tmp_path_factory: pytest.TempPathFactory) -> DictConfig:
    """Two seeds' training scenes, new ones, and a prior that prefers no position."""
    cfg = compose([*SMALL, f"paths.scenes={tmp_path_factory.mktemp('fairness')}"])
    training = {train_pool(seed): (4, "train") for seed in cfg.seeds}
    rendered_scenes(cfg, training | {"val_scenes": (3, "train")})
    write_arrays(Path(cfg.paths.scenes) / "position_prior.npz", {u: np.full((2, 2), 0.4) for u in cfg.evaluate.users})
    return cfg


def test_the_true_code_knows_each_item_and_nothing_of_empty_slots():
    layouts = random_layouts(np.random.default_rng(0), 40, ITEMS, np.arange(4), RULES)
    code = true_code(layouts, 3).reshape(40, 3, -1)
    present = layouts.present[:, :3]
    assert (code[~present] == 0).all() and (~present).any()
    np.testing.assert_array_equal(code[..., -len(SYMBOLS) :].argmax(-1)[present], layouts.symbol[:, :3][present])
    np.testing.assert_allclose(code[..., 0][present] * 0.7 + 0.5, layouts.centre[:, :3, 0][present])
    layouts.angle[:] += np.pi
    np.testing.assert_allclose(true_code(layouts, 3).reshape(code.shape), code, atol=1e-9)
    assert (layouts.symbol[:, 3:] == EMPTY).all()


def test_the_joint_model_answers_each_user_for_itself_and_paths_of_several_at_once():
    torch.manual_seed(0)
    model, z_theta = JointVae(users=2, channels=[2, 2, 2]).eval(), torch.rand(3, 4, 2)
    percept, users = torch.randn(3, model.latent), torch.eye(2)
    each = []
    for model.whose in users[:, None]:
        each.append(model.logit(percept, z_theta))
    assert not torch.allclose(*each)
    model.whose = users[[0, 0, 1, 1]]
    expected = torch.cat([each[0][:, :2], each[1][:, 2:]], dim=1)
    torch.testing.assert_close(model.logit(percept, z_theta), expected)


def test_labels_are_true_and_no_judged_path_was_shown(cfg: DictConfig):
    scenes, families = read_scenes(Path(cfg.paths.scenes)), np.array(cfg.readings.families)
    users = {user: cfg.users[user] for user in cfg.evaluate.users}
    shown = list(draw_judged_sets(cfg, scenes, ROUTES, cfg.studies.fairness.clear_cm, users))
    assert len(shown) == 2 * 2 * 2 * 2, "routes, distances, seeds, users"
    for x in shown:
        for split, (z, valid) in x.judged.items():
            layouts = scenes.layouts["val_scenes" if split == NEW else train_pool(x.seed)]
            np.testing.assert_array_equal(slack(layouts, clearance(layouts, z), cfg.users[x.user]) > 0, valid)
            if x.routes == FEW:
                far = np.linalg.norm(z[:, :, None] - families, axis=-1).min(-1)
                assert far.max() <= cfg.readings.family_radius + 1e-9
        demos, held_out = (x.judged[split][0] for split in (OWN, HELD_OUT))
        np.testing.assert_array_equal(x.z_theta, demos)
        assert np.linalg.norm(demos[:, :, None] - held_out[:, None], axis=-1).min() > 0
