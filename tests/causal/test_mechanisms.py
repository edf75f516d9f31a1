"""Models and world are one structural causal model with other mechanisms."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.causal.mechanisms import expected_validities, model_scm, renderer, true_scm
from pipeline.causal.scm import SCM, Values
from pipeline.models.trained import build
from pipeline.world.bezier import random_z_theta
from pipeline.world.catalogue import read_catalogue
from pipeline.world.layout import EMPTY, LayoutRules, random_layouts
from pipeline.world.render import Palette, render_scenes
from pipeline.world.rules import valid
from tests.factories import composed

SCENES, PATHS = 5, 40
USERS = ["careful", "aggressive"]


@pytest.fixture(scope="module")
def cfg():
    return composed("profile=smoke")


@pytest.fixture(scope="module")
def catalogue(cfg):
    return read_catalogue(Path(cfg.paths.data))


@pytest.fixture(scope="module")
def noise(cfg, catalogue) -> Values:
    rng = np.random.default_rng(0)
    rules = LayoutRules.of(cfg.scenes.layout)
    return {
        "S": np.zeros(SCENES, dtype=int),
        "O": random_layouts(rng, SCENES, catalogue.footprints, catalogue.pool("unseen"), rules),
        "T": np.array(["oak"] * SCENES),
        "I": np.arange(SCENES),
        "Z_theta": random_z_theta(rng, SCENES, PATHS),
        "Z_I": np.zeros(SCENES),
        "V": rng.random((SCENES, PATHS)),
    }


@pytest.fixture(scope="module")
def models(cfg) -> dict:
    return {user: build(cfg.variants["full"], seed).eval() for seed, user in enumerate(USERS)}


@pytest.fixture(scope="module")
def scm(catalogue, models) -> SCM:
    return model_scm(models, renderer(Palette(catalogue)))


@pytest.fixture(scope="module")
def world(cfg) -> SCM:
    return true_scm({user: cfg.users[user] for user in USERS})


def without_items(noise: Values) -> Values:
    layouts = noise["O"]
    nothing = np.full_like(layouts.symbol, EMPTY)
    return {"O": replace(layouts, item=nothing, symbol=nothing)}


def test_a_models_answers_are_its_probabilities_on_the_rendered_images(scm, catalogue, models, noise):
    expected = expected_validities(scm, noise, USERS, [{}, {"T": np.array(["onyx"] * SCENES)}])
    for texture, by_user in zip(("oak", "onyx"), expected, strict=True):
        images = render_scenes(noise["O"], [texture] * SCENES, noise["I"].tolist(), Palette(catalogue))
        for user, answers in zip(USERS, by_user, strict=True):
            p = models[user].probability(images, noise["Z_theta"])
            np.testing.assert_allclose(answers, p.mean(-1), atol=1e-6)
    assert (expected[0] != expected[1]).any()


def test_the_world_answers_by_its_rules(cfg, world, noise):
    as_it_is, empty = expected_validities(world, noise, USERS, [{}, without_items(noise)])
    for user, answers in zip(USERS, as_it_is, strict=True):
        np.testing.assert_array_equal(answers, valid(noise["O"], noise["Z_theta"], cfg.users[user]).mean(-1))
    assert (empty == 1).all() and (as_it_is[0] < 1).any() and (as_it_is[1] == 1).all()
