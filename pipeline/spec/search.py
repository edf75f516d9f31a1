"""Repairs that stay near: the path most likely valid to a specification, less what moving it costs.

Every method maximises log P(valid) - weight * |z - z0| from one start z0, with so many evaluations of the model. Were
P(valid) calibrated, no other ends with the same mean displacement would succeed more often than the maxima of P(valid)
less a multiple of the displacement; its logarithm agrees where P(valid) is high, and has a slope where it is not.
"""

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from numpy import ndarray as Array
from scipy.optimize import minimize
from torch import Tensor
from torch.optim import Rprop

from pipeline.spec.specification import Specification
from pipeline.spec.surrogate import Surrogate
from pipeline.table.bezier import Z_HIGH, Z_LOW

EVEN, DENSER = 0.5, 0.7  # a point's share of the reach is its share of the points to this power: denser near the start
GOLDEN = np.pi * (3 - 5**0.5)  # [rad] between two points: none hides behind another (Vogel, 1979)
CANDIDATES = 64  # paths among which `bayesian` chooses the next one to ask about
FASTER, SLOWER = 1.2, 0.5  # Rprop's (Riedmiller and Braun, 1993)
RESTARTS, STRIDE = 5, 0.2  # of `multistart`: climbs, their first step [m]
ROUNDS, ELITE, SPREAD = 2, 3, 0.6  # of `cem`: generations, samples kept of each, first standard deviation [m]


@dataclass(frozen=True)
class Near:
    """What a search may spend and how `bayesian` spends it (conf/search)."""

    evaluations: int  # of the model, per start
    weight: float  # log P(valid) that a metre of displacement must bring [1/m]
    looks: int  # evaluations spent on looking around first, the start's own included
    climb: int  # evaluations spent on climbing from the best path at last
    reach: float  # distance of the furthest path asked about [m]
    step: float  # first step of the climb in each coordinate [m]


@dataclass(frozen=True)
class Found:
    """Where a search ended."""

    z: Float[Array, "scene start 2"]  # the best path it saw [m], float32
    p: Float[Array, "scene start"]  # P(valid) as the model sees it, float32


class Objective:
    """log P(valid) - weight * distance from the start, of several paths a start; remembers the best it has seen."""

    def __init__(self, model: Specification, percept: Tensor, starts: Float[Tensor, "scene start 2"], weight: float):
        self.model, self.percept, self.starts, self.weight = model, percept, starts, weight
        self.best, self.highest = starts.clone(), torch.full(starts.shape[:2], -torch.inf)
        self.evaluations = 0  # so far, per start

    def value(self, z: Float[Tensor, "scene start k 2"]) -> Float[Tensor, "scene start k"]:
        """Of k paths a start [m]."""
        with torch.no_grad():
            return self._remembered(z, self._logit(z))

    def slope(
        self, z: Float[Tensor, "scene start k 2"]
    ) -> tuple[Float[Tensor, "scene start k"], Float[Tensor, "scene start k 2"]]:
        """The value and its gradient [1/m]."""
        logit, steepness = self.log_odds(z)
        away = (z - self.starts[:, :, None]) / self._distance(z)[..., None]
        return self.of(z, logit), (-logit).sigmoid()[..., None] * steepness - self.weight * away

    def log_odds(
        self, z: Float[Tensor, "scene start k 2"]
    ) -> tuple[Float[Tensor, "scene start k"], Float[Tensor, "scene start k 2"]]:
        """The model's log-odds of validity and their gradient [1/m]."""
        z = z.detach().requires_grad_()
        with torch.enable_grad():
            logit = self._logit(z)
            (slope,) = torch.autograd.grad(logit.sum(), z)
        logit = logit.detach()
        self._remembered(z.detach(), logit)
        return logit, slope

    def of(self, z: Float[Tensor, "scene start k 2"], logit: Tensor) -> Float[Tensor, "scene start k"]:
        """The value of paths [m] that have these log-odds of validity."""
        return F.logsigmoid(logit) - self.weight * self._distance(z)

    def p(self) -> Float[Tensor, "scene start"]:
        """P(valid) of the best path of each start."""
        return (self.highest + self.weight * self._distance(self.best[:, :, None])[..., 0]).exp()

    def _logit(self, z: Tensor) -> Tensor:
        return self.model.logit(self.percept, z.flatten(1, 2)).unflatten(1, z.shape[1:3])

    def _distance(self, z: Tensor) -> Tensor:
        return ((z - self.starts[:, :, None]).square().sum(-1) + 1e-12).sqrt()

    def _remembered(self, z: Tensor, logit: Tensor) -> Tensor:
        value = self.of(z, logit)
        self.evaluations += z.shape[2]
        highest, at = value.max(-1)
        better = highest > self.highest
        best = torch.take_along_dim(z, at[..., None, None], 2)[:, :, 0]
        self.best = torch.where(better[..., None], best, self.best)
        self.highest = torch.where(better, highest, self.highest)
        return value


def search(
    model: Specification,
    percept: Tensor,
    starts: Float[Array, "scene start 2"],
    method: str,
    near: Near,
    seed: int,
) -> Found:
    """The best path that one of METHODS sees from every start [m], in scenes as `model.perceive` sees them."""
    z0 = torch.as_tensor(np.asarray(starts, dtype=np.float32)).clamp(Z_LOW, Z_HIGH)
    objective = Objective(model, percept, z0, near.weight)
    METHODS[method](objective, near, np.random.default_rng(seed))
    return Found(objective.best.numpy(), objective.p().numpy())


def bayesian(objective: Objective, near: Near, rng: np.random.Generator) -> None:
    """Bayesian optimisation: ask next about the path that could be the best one (Cox and John, 1992), climb at last.

    A surrogate says how good each candidate could be; the first looks lie on a spiral, densest near the start. None is
    further away than a certainly valid path could be better than the best one seen: there log P(valid) is 0.
    """
    surrogate = Surrogate()

    def ask(z: Tensor) -> None:
        surrogate.learn(z, *objective.log_odds(z))

    ask(objective.starts[:, :, None])
    if near.looks > 1:
        ask(_spiral(objective, near, np.arange(near.looks - 1), DENSER))
    for turn in range(near.evaluations - near.looks - near.climb):
        candidates = _spiral(objective, near, turn * CANDIDATES + np.arange(CANDIDATES), EVEN)
        best = objective.of(candidates, surrogate.bound(candidates)).argmax(-1)
        ask(torch.take_along_dim(candidates, best[..., None, None], 2))
    _climb(objective, objective.best[:, :, None], near.climb, near.step)


def _spiral(objective: Objective, near: Near, k: Int[Array, " point"], power: float) -> Tensor:
    """Points on a sunflower's spiral about each start [m], (scene, start, point, 2), as far as is worth looking."""
    radius, angle = ((k - k[0] + 1) / len(k)) ** power, k * GOLDEN
    around = torch.from_numpy(np.stack([radius * np.cos(angle), radius * np.sin(angle)], -1)).float()
    reach = (-objective.highest / near.weight).clamp(max=near.reach)
    return _inside(objective.starts[:, :, None] + reach[..., None, None] * around)


def multistart(objective: Objective, near: Near, rng: np.random.Generator) -> None:
    """Climb from the start and from random paths, with equal shares of the evaluations."""
    others = rng.uniform(Z_LOW, Z_HIGH, (*objective.starts.shape[:2], RESTARTS - 1, 2)).astype(np.float32)
    z = torch.cat([objective.starts[:, :, None], torch.from_numpy(others)], 2)
    _climb(objective, z, near.evaluations // RESTARTS, STRIDE)


def cem(objective: Objective, near: Near, rng: np.random.Generator) -> None:
    """The cross-entropy method (Rubinstein, 1999): a normal distribution, refitted to its best samples."""
    size = near.evaluations // ROUNDS
    mean = objective.starts[:, :, None]
    spread = torch.full_like(mean, SPREAD)
    for _ in range(ROUNDS):
        noise = torch.from_numpy(rng.standard_normal((*mean.shape[:2], size, 2)).astype(np.float32))
        z = _inside(mean + spread * noise)
        elite = objective.value(z).topk(min(ELITE, size), dim=-1).indices
        kept = torch.take_along_dim(z, elite[..., None], 2)
        mean, spread = kept.mean(2, keepdim=True), kept.std(2, correction=0, keepdim=True)


def lbfgs(objective: Objective, near: Near, rng: np.random.Generator) -> None:
    """scipy's L-BFGS-B (Byrd et al., 1995), one start after the other."""
    for scene, start in np.ndindex(*objective.starts.shape[:2]):
        here = objective.starts[scene : scene + 1, start : start + 1]
        own = Objective(objective.model, objective.percept[scene : scene + 1], here, objective.weight)
        bounds = [(Z_LOW, Z_HIGH)] * 2
        minimize(_downhill, here.numpy().ravel(), (own, near.evaluations), "L-BFGS-B", jac=True, bounds=bounds)
        objective.best[scene, start], objective.highest[scene, start] = own.best[0, 0], own.highest[0, 0]


def _downhill(z: Float[Array, "2"], objective: Objective, evaluations: int) -> tuple[float, Float[Array, "2"]]:
    """What scipy minimises; level, so that it stops, once the evaluations are spent."""
    if objective.evaluations >= evaluations:
        return 0.0, np.zeros(2)
    value, slope = objective.slope(torch.from_numpy(z).float().view(1, 1, 1, 2))
    return -float(value), -slope.numpy().ravel().astype(np.float64)


def _climb(objective: Objective, z: Float[Tensor, "scene start k 2"], steps: int, step: float) -> None:
    """Rprop: each coordinate's step grows while its slope keeps its sign, and shrinks and pauses when it turns."""
    z = z.clone()
    optimiser = Rprop([z], lr=step, etas=(SLOWER, FASTER), maximize=True)
    for _ in range(steps):
        _, z.grad = objective.slope(z)
        optimiser.step()
        z.clamp_(Z_LOW, Z_HIGH)


def _inside(z: Tensor) -> Tensor:
    """Cut off at the edge of the z_theta square."""
    return z.clamp(Z_LOW, Z_HIGH)


METHODS = {f.__name__: f for f in (bayesian, multistart, cem, lbfgs)}
