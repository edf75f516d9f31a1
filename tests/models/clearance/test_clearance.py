"""The clearance model: its clearances against the world's, its symmetries, what it learns."""

import numpy as np
import pytest
import torch

from pipeline.models.base import to_tensor
from pipeline.models.clearance.clearance import ClearanceModel, passes
from pipeline.training.clearance.fit import fit
from pipeline.training.loop import Checkpoints, Schedule
from pipeline.world.rules import clearance as true_clearance
from tests.factories import capsules, clearance_model, percept, two_discs

SCHEDULE = Schedule(steps=400, rate=0.03, weight_decay=0.0, curve_every=50)
MARGIN = 0.04  # metres


def fit_one(m: ClearanceModel, images, z, valid, seed=0, checkpoints=None) -> np.ndarray:
    """Its learning curve."""
    (curve,) = fit([m], [images], [z], [valid], SCHEDULE, [seed], checkpoints)
    return curve


def test_clearances_are_those_of_the_world():
    rng = np.random.default_rng(0)
    layouts, z = capsules(rng), rng.uniform(-0.2, 1.2, (20, 50, 2))
    ours = passes(percept(layouts), torch.tensor(z), dwell=False).clearance[..., 0].numpy()
    theirs = true_clearance(layouts, z)
    apart = theirs > 0.02  # nearer, and inside, both only need to say that it is too near
    np.testing.assert_allclose(ours[apart], theirs[apart], rtol=0, atol=6e-4)
    assert (ours[~apart] < 0.0205).all()


def test_turned_and_reflected_scenes_are_the_same_to_it():
    rng = np.random.default_rng(2)
    seen, z = percept(capsules(rng)), torch.tensor(rng.uniform(-0.2, 1.2, (20, 8, 2)))
    m = clearance_model(families=["margin", "dwell", "proximity"]).double()
    m.get_buffer("evidence").fill_(1.0)
    here = m.logit(seen, z)
    for same in (lambda p: p.flip(-1), lambda p: 1 - p):  # across the start-goal diagonal; by 180 degrees
        ends = same(seen[..., :4].unflatten(-1, (2, 2))).flatten(-2)
        there = m.logit(torch.cat([ends, seen[..., 4:]], -1), same(z))
        torch.testing.assert_close(here, there, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("relevant", [(True, True), (False, True)])
def test_it_learns_which_objects_matter_and_their_margin(relevant):
    rng = np.random.default_rng(3)
    layouts, images = two_discs(rng, 40)
    z = rng.uniform(-0.2, 1.2, (40, 10, 2))
    valid = np.where(relevant, true_clearance(layouts, z), np.inf).min(-1) > MARGIN
    m = clearance_model()
    curve = fit_one(m, images[:20], z[:20], valid[:20])
    assert curve[-1, 1] < curve[0, 1]
    right = (m.probability(images[20:], z[20:]) > 0.5) == valid[20:]
    assert right.mean() > 0.95
    relevance = m.logit_relevance(m.perceive(to_tensor(images[20:])), [0]).sigmoid().mean((0, 2))[:2].detach().numpy()
    assert ((relevance > 0.5) == relevant).all()


@pytest.mark.slow
def test_a_seed_gives_the_same_bits_and_checkpoints_keep_the_evidence_of_their_step_and_change_none():
    rng = np.random.default_rng(6)
    layouts, images = two_discs(rng, 20)
    z = rng.uniform(-0.2, 1.2, (20, 10, 2))
    valid = true_clearance(layouts, z).min(-1) > MARGIN
    before, checkpoints = torch.random.get_rng_state(), Checkpoints([0, 200, 399])
    plain, kept, other = (clearance_model() for _ in range(3))
    curve = fit_one(plain, images, z, valid, 7)
    assert np.array_equal(fit_one(kept, images, z, valid, 7, checkpoints), curve)
    fit_one(other, images, z, valid, 8)
    assert torch.equal(before, torch.random.get_rng_state())
    assert all(torch.equal(value, kept.state_dict()[name]) for name, value in plain.state_dict().items())
    assert not torch.equal(plain.margin, other.margin)
    evidence = [float(state["evidence"][0]) for state in checkpoints.of(kept).values()]
    assert evidence == sorted(evidence) and evidence[0] < evidence[1] - 10
    assert evidence[2] < float(kept.evidence[0]) + 1e-3


@pytest.mark.slow
def test_models_fitted_together_answer_as_each_does_alone():
    """Whatever the n of the others, and one among them whose labels never vary; but for rounding."""
    rng = np.random.default_rng(8)
    training_sets = []
    for n in (10, 3, 5):
        layouts, images = two_discs(rng, 8)
        z = rng.uniform(-0.2, 1.2, (8, n, 2))
        training_sets.append((images, z, true_clearance(layouts, z).min(-1) > MARGIN))
    training_sets[1] = (*training_sets[1][:2], np.ones((8, 3), bool))
    alone, together = ([clearance_model(seed) for seed in range(3)] for _ in range(2))
    curves = [fit_one(m, *one, seed=i) for i, (m, one) in enumerate(zip(alone, training_sets, strict=True))]
    images, z, valid = zip(*training_sets, strict=True)
    batch_size = fit(together, images, z, valid, SCHEDULE, range(3))
    asked = np.random.default_rng(9).uniform(-0.2, 1.2, (8, 30, 2))
    for i, (images, *_) in enumerate(training_sets):
        one, other = (m.probability(images, asked) for m in (alone[i], together[i]))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-4)
        np.testing.assert_allclose(curves[i], batch_size[i], rtol=1e-4)
    assert len({float(m.evidence[0]) for m in together}) == 3
