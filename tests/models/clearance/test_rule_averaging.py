"""Model averaging over rule families: the family behind the labels is the most probable."""

import numpy as np
import pytest
import torch

from pipeline.models.clearance.clearance import DWELL_SHARES, ClearanceModel, PerceivedObjects, passes
from pipeline.training.clearance.fit import fit
from pipeline.training.loop import Schedule
from pipeline.world.bezier import random_z_theta
from pipeline.world.layout import SYMBOLS, Layouts, random_layouts
from pipeline.world.rules import Margins
from tests.factories import ITEMS, clearance_model, percept
from tests.factories import RULES as LAYOUT_RULES
from tests.rule_families import FAMILIES as RULES
from tests.rule_families import dwell, proximity, side

SCENES, DEMOS = 20, 9
ALL: Margins = {symbol: 0.045 for symbol in SYMBOLS}
AMOUNTS = {"margin": 0.0, "dwell": 0.1, "side": 0.0, "proximity": 0.2}


@pytest.fixture(scope="module")
def world() -> tuple[Layouts, np.ndarray]:
    rng = np.random.default_rng(3)
    layouts = random_layouts(rng, SCENES, ITEMS, np.arange(4), LAYOUT_RULES)
    return layouts, random_z_theta(rng, SCENES, DEMOS)


def fitted(world: tuple[Layouts, np.ndarray], valid: np.ndarray, steps: int = 400) -> ClearanceModel:
    layouts, z = world
    model = clearance_model()
    model.perceive = lambda images: percept(layouts).float()
    schedule = Schedule(steps=steps, rate=0.03, weight_decay=0.0, curve_every=100)
    fit([model], [np.zeros((SCENES, 100, 100, 3), np.uint8)], [z], [valid], schedule, [0])
    return model


@pytest.mark.slow
@pytest.mark.parametrize("family", RULES)
def test_the_family_that_labelled_the_paths_is_the_most_probable_and_judges_new_ones(world, family: str):
    """One clearance can represent neither `side` nor `proximity`."""
    layouts, z = world
    rule, amount = RULES[family], AMOUNTS[family]
    model = fitted(world, rule(layouts, z, ALL, amount))
    assert model.families[int(model.posterior()[:-1].argmax())] == family
    if family not in ("side", "proximity"):
        return
    new = random_z_theta(np.random.default_rng(7), SCENES, 60)
    with torch.no_grad():
        judged = model.logit(percept(layouts).float(), torch.tensor(new).float()).numpy() > 0
    truth = rule(layouts, new, ALL, amount)
    nearest = RULES["margin"](layouts, new, ALL, 0.0)
    assert (judged == truth).mean() > 0.93 > (nearest == truth).mean()


@pytest.mark.slow
def test_random_labels_leave_one_rate(world):
    labels = np.random.default_rng(0).random((SCENES, DEMOS)) < 0.5
    model = fitted(world, labels)
    assert model.posterior()[-1] > 0.5
    never = fitted(world, np.ones((SCENES, DEMOS), bool), steps=1)
    assert never.posterior()[-1] == 1
    with torch.no_grad():
        p = never.logit(percept(world[0]).float(), torch.tensor(world[1]).float()).sigmoid()
    np.testing.assert_allclose(p, 181 / 182, atol=1e-5)


def test_relations_to_objects_are_those_of_the_rules(world):
    layouts, z = world
    passing = passes(percept(layouts).float(), torch.tensor(z).float())
    assert (passing.clearance[..., 1:].diff(dim=-1) >= 0).all()
    slots = passing.clearance.shape[2]
    near = (passing.clearance[..., 0] < 0.045).numpy() & layouts.present[:, None, :slots]
    right = passing.relations[..., 0].numpy()
    log_gap = PerceivedObjects.of(percept(layouts).float()).features[:, None, :slots, -1].numpy()
    tenth = int((DWELL_SHARES - AMOUNTS["dwell"]).abs().argmin())
    broken = {
        side: near & (right > 0), proximity: near & (log_gap <= np.log(0.2)),
        dwell: near & (passing.clearance[..., tenth] < 0.045).numpy(),
    }  # fmt: skip
    alone = near.sum(-1) <= 1  # near several items, `dwell` adds up the time near each
    for rule, offends in broken.items():
        agree = rule(layouts, z, ALL, AMOUNTS[rule.__name__]) == ~offends.any(-1)
        assert agree[alone].mean() > (0.93 if rule is dwell else 0.985), rule  # 12 of 129 points, or 4 of 41
