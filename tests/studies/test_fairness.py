"""A perfect encoder knows each item, and a joint model answers each user for itself."""

import numpy as np
import torch

from pipeline.world.layout import EMPTY, SYMBOLS, random_layouts
from studies.fairness.stage import JointVae, true_code
from tests.factories import ITEMS, RULES


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
