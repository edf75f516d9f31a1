"""Facts about inverse reinforcement learning: gradients, what each form learns from, and the acceptance rule."""

import numpy as np
import pytest
import torch

from pipeline.models.irl.reward_map import RewardMap
from pipeline.training.irl.augment import ColorJitter
from pipeline.training.irl.fit import IrlSchedule, fit, logistic, maxent, ranked
from tests.factories import reward_model

JITTER = ColorJitter(hue=0.3, gain=0.15, shift=0.01, scene_gain=0.1, other_table=0.5)


def schedule(**changes) -> IrlSchedule:
    values = {
        "steps": 12, "rate": 0.01, "weight_decay": 1e-4, "scenes_per_step": 20, "n_augmentations": 2, "curve_every": 1,
        "color_jitter": JITTER,
    }  # fmt: skip
    return IrlSchedule(**(values | changes))


def fit_one(model: RewardMap, images, z, valid, objective: str, settings: IrlSchedule, seed: int):
    """Its learning curve."""
    (curve,) = fit([model], [images], [z], [valid], objective, settings, [seed])
    return curve


def world(scenes: int = 4, n: int = 6):
    """Grey tables with a red disc each; a path is valid if it stays clear of the disc."""
    rng = np.random.default_rng(2)
    centre = rng.uniform(0.35, 0.65, (scenes, 2))
    y, x = 1 - (np.mgrid[0:100, 0:100][0] + 0.5) / 100, (np.mgrid[0:100, 0:100][1] + 0.5) / 100
    disc = np.hypot(x - centre[:, 0, None, None], y - centre[:, 1, None, None]) < 0.08
    images = np.where(disc[..., None], (200, 60, 50), (120, 120, 120)) + rng.normal(0, 2, (scenes, 100, 100, 3))
    z = rng.uniform(-0.2, 1.2, (scenes, n, 2))
    middle = 0.25 + 0.5 * z  # the path at t = 1/2
    valid = np.linalg.norm(middle - centre[:, None], axis=-1) > 0.2
    return np.clip(images, 0, 255).astype(np.uint8), z, valid


VALID = torch.tensor([[True, False, True], [False, False, True], [True, True, True]])


def test_maxent_uses_valid_demonstrations_alone():
    advantage = torch.tensor([[1.0, 5.0, 3.0], [9.0, 9.0, 2.0], [0.0, 0.0, 0.0]])
    assert maxent(advantage, VALID).item() == pytest.approx(-(1 + 3 + 2) / 6)
    torch.testing.assert_close(maxent(torch.where(VALID, advantage, -1e6), VALID), maxent(advantage, VALID))


def test_ranking_compares_each_valid_path_with_each_invalid_one_of_all_scenes():
    advantage = torch.tensor([[2.0, 1.0, 0.0], [-1.0, 0.5, 3.0], [1.0, 1.0, 1.0]])
    pairs = [np.log1p(np.exp(-(better - worse))) for better in (2, 0, 3, 1, 1, 1) for worse in (1, -1, 0.5)]
    assert ranked(advantage, VALID).item() == pytest.approx(np.mean(pairs), rel=1e-5)


def test_a_model_depends_on_its_seed_and_not_on_those_fitted_before_it():
    results = []
    for scenes, seed in ((5, 1), (5, 1), (4, 1), (5, 1), (5, 2)):  # appearances drawn, cached, replaced, drawn again
        model = reward_model(1)
        fit_one(model, *world(scenes), "ranked", schedule(), seed)
        results.append([value.numpy() for value in model.state_dict().values()])
    same = [all(np.array_equal(x, y) for x, y in zip(results[0], other, strict=True)) for other in results]
    assert same == [True, True, False, True, False]


@pytest.mark.slow
@pytest.mark.parametrize(("objective", "least"), [("maxent", 0.7), ("ranked", 0.9)])
def test_fitting_ranks_valid_paths_above_invalid_ones(objective, least):
    images, z, valid = world(12, 9)
    model = reward_model(0)
    curve = fit_one(model, images, z, valid, objective, schedule(steps=30), 0)
    assert curve[-5:, 1].mean() < curve[:5, 1].mean()
    p = model.probability(images, z)
    assert (p[valid][:, None] > p[~valid]).mean() > least  # area under the ROC curve


def test_the_acceptance_rule_is_the_maximum_of_the_likelihood_finite_and_never_turned_round():
    rng = np.random.default_rng(0)
    advantage = rng.normal(0, 2, 400)
    valid = rng.random(400) < 1 / (1 + np.exp(-(1.5 * advantage + 0.7)))
    scale, offset = logistic(advantage, valid)
    target = np.where(valid, (valid.sum() + 1) / (valid.sum() + 2), 1 / ((~valid).sum() + 2))
    left = 1 / (1 + np.exp(-(scale * advantage + offset))) - target
    assert abs(left.sum()) < 1e-6 and abs((left * advantage).sum()) < 1e-6  # the gradient vanishes
    assert scale == pytest.approx(1.5, abs=0.4) and offset == pytest.approx(0.7, abs=0.4)
    advantage = np.array([-3.0, -2.0, 1.0, 2.0])
    scale, offset = logistic(advantage, advantage > 0)
    assert 0 < scale < 100 and np.array_equal(scale * advantage + offset > 0, advantage > 0)
    assert logistic(advantage, advantage < 0)[0] == 0.0  # worse than nothing: the score's sign is not turned round
