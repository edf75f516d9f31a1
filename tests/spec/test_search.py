"""Searches stay near: they find the known optima of objectives whose shape is known, within their budget."""

import numpy as np
import pytest
import torch
from scipy.optimize import minimize
from torch import Tensor

from pipeline.spec.search import ELITE, METHODS, Near, Objective, search
from pipeline.spec.specification import Specification
from pipeline.table.bezier import Z_HIGH, Z_LOW, random_z_theta

STARTS = random_z_theta(np.random.default_rng(0), 3, 20)
PERCEPT = torch.zeros(3, 1)
NEAR = Near(30, 1.0, 11, 5, 1.2, 0.01)


class Disc(Specification):
    """Paths whose z lies in a disc about the middle are invalid, all others valid: log-odds grow with the distance."""

    radius = 0.3

    def perceive(self, images: Tensor) -> Tensor:
        return torch.zeros(len(images), 1)

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return 60 * ((z_theta - 0.5).norm(dim=-1) - self.radius)


class Blind(Disc):
    """Log-odds that do not depend on the path."""

    def logit(self, percept: Tensor, z_theta: Tensor) -> Tensor:
        return 0 * z_theta.sum(-1) - 1


class Diary(Objective):
    """Notes each look around, and how good the best path had been before it."""

    def __init__(self, model: Specification, starts: np.ndarray):
        super().__init__(model, PERCEPT, torch.tensor(starts).float(), NEAR.weight)
        self.looks = []

    def _remembered(self, z: Tensor, logit: Tensor) -> Tensor:
        before = self.highest.clone()
        value = super()._remembered(z, logit)
        self.looks.append((z, before, value))
        return value


def least(start: np.ndarray, weight: float) -> float:
    """The optimum of one start, along the ray from the middle on which it lies by symmetry."""
    offset = float(np.linalg.norm(start - 0.5))

    def cost(r):
        return np.logaddexp(0, -60 * (r - Disc.radius)) + weight * abs(r - offset)

    return -min(minimize(cost, x, method="Nelder-Mead").fun for x in (offset, Disc.radius + 0.1))


@pytest.mark.parametrize("method", METHODS)
def test_no_search_ends_worse_than_it_started_or_better_than_the_optimum(method: str):
    found = search(Disc(), PERCEPT, STARTS, method, NEAR, 0)
    value = np.log(found.p) - NEAR.weight * np.linalg.norm(found.z - STARTS, axis=-1)
    optimum = np.array([[least(z, NEAR.weight) for z in scene] for scene in STARTS])
    assert (value <= optimum + 1e-4).all()
    offset = np.linalg.norm(STARTS - 0.5, axis=-1)
    if method != "cem":  # which does not look at the start itself
        assert (value >= -np.logaddexp(0, -60 * (offset - Disc.radius)) - 1e-4).all()


def short_of_the_optimum(method: str) -> np.ndarray:
    """How far the value of each start's best path stays below what is possible."""
    found = search(Disc(), PERCEPT, STARTS, method, NEAR, 0)
    value = np.log(found.p) - NEAR.weight * np.linalg.norm(found.z - STARTS, axis=-1)
    return np.array([[least(z, NEAR.weight) for z in scene] for scene in STARTS]) - value


def test_bayesian_optimisation_comes_within_a_centimetre_of_the_optimum():
    short = short_of_the_optimum("bayesian")
    assert short.max() < 0.01 / NEAR.weight


@pytest.mark.parametrize("rival", ["multistart", "cem"])
def test_bayesian_optimisation_comes_nearer_to_the_optimum_than_its_rivals(rival: str):
    assert short_of_the_optimum("bayesian").mean() < short_of_the_optimum(rival).mean() / 10


def test_what_a_valid_path_would_gain_by_moving_costs_more_than_it_brings():
    far = np.linalg.norm(STARTS - 0.5, axis=-1) > Disc.radius + 0.15
    found = search(Disc(), PERCEPT, STARTS, "bayesian", NEAR, 0)
    assert far.any()
    np.testing.assert_allclose(found.z[far], STARTS[far], atol=1e-6)


def test_no_look_goes_further_than_a_certainly_valid_path_would_be_worth():
    diary = Diary(Disc(), STARTS)
    METHODS["bayesian"](diary, NEAR, np.random.default_rng(0))
    one_by_one = NEAR.evaluations - NEAR.looks
    assert [z.shape[2] for z, _, _ in diary.looks] == [1, NEAR.looks - 1] + [1] * one_by_one
    for z, before, _ in diary.looks[: -NEAR.climb]:
        distance = (z - diary.starts[:, :, None]).norm(dim=-1).amax(-1)
        assert (NEAR.weight * distance <= -before + 1e-5).all()


def test_the_cross_entropy_methods_second_generation_spreads_as_the_best_of_the_first():
    diary = Diary(Blind(), np.full_like(STARTS, 0.5))
    METHODS["cem"](diary, NEAR, np.random.default_rng(0))
    (z, _, value), (later, _, _) = diary.looks
    best = torch.take_along_dim(z, value.argsort(-1, descending=True)[..., :ELITE, None], 2)
    off = (later - best.mean(2, keepdim=True)) / best.std(2, correction=0, keepdim=True)
    assert abs(float(off.mean())) < 0.1 and float(off.std()) == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("method", ["bayesian", "multistart", "cem"])
def test_a_search_spends_what_it_may(method: str):
    objective = Objective(Disc(), PERCEPT, torch.tensor(STARTS).float(), NEAR.weight)
    METHODS[method](objective, NEAR, np.random.default_rng(0))
    assert objective.evaluations == NEAR.evaluations


def test_the_slope_of_a_value_is_the_one_that_differentiation_finds():
    objective = Objective(Disc(), PERCEPT, torch.tensor(STARTS).float(), NEAR.weight)
    z = torch.tensor(STARTS).float()[:, :, None] + 0.1 * torch.randn(
        3, 20, 4, 2, generator=torch.Generator().manual_seed(0)
    )
    value, slope = objective.slope(z)
    asked = z.clone().requires_grad_()
    again = objective.of(asked, Disc().logit(PERCEPT, asked))
    torch.testing.assert_close(value, again.detach())
    torch.testing.assert_close(slope, torch.autograd.grad(again.sum(), asked)[0], atol=1e-4, rtol=1e-4)


def test_lbfgs_spends_no_more_than_it_may(monkeypatch: pytest.MonkeyPatch):
    asked = []
    logit = Disc.logit
    monkeypatch.setattr(Disc, "logit", lambda self, percept, z: asked.append(1) or logit(self, percept, z))
    search(Disc(), PERCEPT[:1], STARTS[:1, :1], "lbfgs", NEAR, 0)
    assert 1 < len(asked) <= NEAR.evaluations


@pytest.mark.parametrize("method", ["bayesian", "lbfgs"])  # the others draw for all starts together
def test_no_start_sees_another(method: str):
    together = search(Disc(), PERCEPT, STARTS, method, NEAR, 0)
    alone = search(Disc(), PERCEPT[1:2], STARTS[1:2, 3:4], method, NEAR, 0)
    np.testing.assert_allclose(alone.z[0, 0], together.z[1, 3], atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_ends_lie_in_the_square_of_z_theta_and_p_is_the_models(method: str):
    found = search(Disc(), PERCEPT, STARTS, method, NEAR, 0)
    assert (found.z >= Z_LOW).all() and (found.z <= Z_HIGH).all()
    with torch.no_grad():
        p = Disc().logit(PERCEPT, torch.tensor(found.z)).sigmoid()
    np.testing.assert_allclose(found.p, p, atol=1e-5)


@pytest.mark.parametrize("method", ["bayesian", "lbfgs"])
def test_a_model_that_ignores_the_path_moves_nothing(method: str):
    found = search(Blind(), PERCEPT, STARTS, method, NEAR, 0)
    np.testing.assert_allclose(found.z, STARTS, atol=1e-6)
