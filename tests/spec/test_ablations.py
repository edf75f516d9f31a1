"""Every ablation lacks what its name says, and nothing else."""

import numpy as np
import pytest
import torch
from scipy.special import expit, logit

from pipeline.spec.ablations import ABLATIONS
from pipeline.spec.clearance import SHARPENING, ClearanceModel, clearance, fit
from pipeline.spec.descent import Schedule
from pipeline.spec.specification import to_tensor, untrained
from pipeline.spec.things import FEATURES
from pipeline.table.rules import clearance as true_clearance
from tests.spec.test_clearance import MARGIN, scenes

SHORT = Schedule(steps=30, rate=0.03, weight_decay=0.0, curve_every=10)
Z = np.random.default_rng(1).uniform(-0.2, 1.2, (6, 10, 2))
LAYOUTS, PICTURES = scenes(np.random.default_rng(0), 6)
VALID = true_clearance(LAYOUTS, Z).min(-1) > MARGIN


def fitted(name: str) -> ClearanceModel:
    changed = ABLATIONS[name]
    model = untrained(changed.kind, {"members": 4, **changed.model}, 0)
    assert isinstance(model, ClearanceModel)
    fit([model], [PICTURES], [Z], [VALID], SHORT, [0])
    return model


@pytest.mark.parametrize("name", [name for name in ABLATIONS if name not in ("whole", "no_evidence")])
def test_it_learns_something_else_than_the_whole_model(name):
    p = fitted(name).probability(PICTURES, Z)
    assert ((p >= 0) & (p <= 1)).all()
    assert not np.allclose(p, fitted("whole").probability(PICTURES, Z), atol=1e-3)


def test_without_shape_or_contrast_things_look_alike_in_it():
    model, other = fitted("no_shape"), fitted("no_contrast")
    seen = model.perceive(to_tensor(PICTURES)), other.perceive(to_tensor(PICTURES))
    assert (seen[0][..., 5:9] == 0).all() and (seen[0][..., 9:11] != 0).any()
    assert (seen[1][..., 9:11] == 0).all() and (seen[1][..., 5:9] != 0).any()


def test_without_squares_relevance_is_monotonic():
    terms, whole = (
        fitted(name).terms(torch.linspace(-9, 9, 50)[:, None].expand(-1, len(FEATURES)))
        for name in ("no_squares", "whole")
    )
    assert (terms.diff(dim=0) >= 0).all() and not (whole.diff(dim=0) >= 0).all()


def test_members_see_every_feature_or_some():
    assert fitted("every_feature").sees.all() and not fitted("whole").sees.all()


def test_discs_have_the_areas_of_the_things():
    seen, discs = (fitted(name).perceive(to_tensor(PICTURES)) for name in ("whole", "discs"))
    length, radius = (seen[..., 2:4] - seen[..., :2]).norm(dim=-1), seen[..., 4]
    torch.testing.assert_close(torch.pi * discs[..., 4] ** 2, torch.pi * radius**2 + 2 * radius * length)
    assert torch.equal(discs[..., :2], discs[..., 2:4])
    assert torch.equal(discs[..., 5:], seen[..., 5:])


def test_margins_and_what_is_unseen_stay_where_they_are():
    assert (fitted("no_margin").margin == 0).all() and (fitted("whole").margin != 0).all()
    assert fitted("nothing_unseen").clear.sigmoid().min() > 1 - 1e-5


def mean_of_members(model: ClearanceModel) -> np.ndarray:
    with torch.no_grad():
        seen = model.perceive(to_tensor(PICTURES))
        return model.log_valid(seen, clearance(seen, torch.tensor(Z).float())).exp().mean(0).double().numpy()


def test_without_sharpening_evidence_weighs_the_members_mean_itself():
    model = fitted("no_sharpening")
    model.evidence.fill_(0.7)
    believed = expit(0.7)
    expected = believed * mean_of_members(model) + (1 - believed) * float(model.rate)
    np.testing.assert_allclose(model.probability(PICTURES, Z), expected, atol=1e-5)


def test_without_evidence_the_mean_is_sharpened_and_believed():
    model = fitted("no_evidence")
    model.evidence.fill_(-20.0)
    np.testing.assert_allclose(
        model.probability(PICTURES, Z), expit(SHARPENING * logit(mean_of_members(model))), atol=1e-4
    )


def test_one_member_is_one():
    assert len(fitted("one_member").margin) == 1
