"""The clearance model says when it does not know: a picture unlike its training lowers its confidence."""

import numpy as np
import pytest
import torch

from pipeline.models.base import to_tensor
from pipeline.models.clearance.clearance import ClearanceModel, PerceivedObjects
from pipeline.training.clearance.fit import set_feature_scaling
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import random_scenes
from pipeline.world.render import read_palette, render_scenes
from studies.shift.stage import blur
from tests.factories import RULES, clearance_model

TRAINED, ASKED = 20, 6


@pytest.fixture(scope="module")
def world() -> tuple[ClearanceModel, np.ndarray, np.ndarray]:
    """A model that has seen pictures but no labels and is sure of its margins, other pictures, and paths."""
    catalogue, palette = read_palette("data")
    layouts, appearance = random_scenes(np.random.default_rng(5), TRAINED + ASKED, catalogue, "train", RULES)
    images = render_scenes(layouts, appearance["texture"].tolist(), appearance["render_seed"].tolist(), palette)
    model = clearance_model()
    set_feature_scaling(model, images[:TRAINED])
    model.get_buffer("evidence")[0] = 20.0
    return model, images[TRAINED:], random_z_theta(np.random.default_rng(6), ASKED, 40)


def test_pictures_like_those_of_training_are_trusted_and_blurred_ones_are_not(world):
    model, images, _ = world
    assert (model.trust(model.perceive(to_tensor(images))) == 1).all()
    trust = model.trust(model.perceive(to_tensor(blur(np.random.default_rng(7), images, 4.0))))
    assert (trust < 0.5).all() and (trust > 0).all()


@pytest.mark.parametrize("doubt", [0.0, 1.0, 5.0, 50.0])
def test_doubt_lowers_confidence_and_flips_no_decision(world, doubt: float):
    model, images, z = world
    fields, paths = PerceivedObjects.of(model.perceive(to_tensor(images))), torch.from_numpy(z).float()
    with torch.no_grad():
        sure = model.logit(fields._replace(doubt=0 * fields.doubt).percept(), paths)
        doubted = model.logit(fields._replace(doubt=doubt + 0 * fields.doubt).percept(), paths)
    assert torch.equal(doubted > 0, sure > 0)
    assert torch.equal(doubted, sure) if doubt == 0 else (doubted.abs() < sure.abs()).all()
