"""Inverse reinforcement learning of a reward map, in two forms, and the acceptance rule fitted afterwards.

`maxent`: maximum entropy IRL on the valid demonstrations alone, as a baseline without negative examples has it
(Ziebart et al., 2008); z_theta is two-dimensional, so the partition function is a sum over a lattice, not a sample.
`ranked`: every valid demonstration is preferred to every invalid one (Bradley and Terry, 1952), which uses the same
information as the specification model. Both then turn soft regret into P(valid) by a logistic fit on all labels.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any
from zlib import crc32

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from scipy.special import expit
from torch import Tensor

from pipeline.models.base import to_tensor
from pipeline.models.irl.reward_map import SYMMETRIES, RewardMap, contrast, transform, untransform
from pipeline.perception.background import subtract_background
from pipeline.training import loop as descent
from pipeline.training.irl.augment import Jitter, blobs, new_looks
from pipeline.training.loop import Checkpoints, is_constant, rule_of_succession
from pipeline.world.layout import SIDE

OBJECTIVES = ("maxent", "ranked")
CURVE = ("step", "total")  # columns of a learning curve


@dataclass(frozen=True)
class Schedule(descent.Schedule):
    """How a reward map is trained (conf/irl)."""

    scenes_per_step: int  # drawn without replacement; more than there are: all
    copies: int  # looks of each training scene, drawn once, then picked from at random
    sparsity: float  # weight of the mean absolute reward: no reward where nothing speaks for one
    across: bool  # rank over all scenes (soft regrets compare) or only within each
    jitter: Jitter

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "Schedule":
        """The schedule from conf/irl, and the variant's `steps`."""
        numbers = {name: float(values[name]) for name in ("rate", "weight_decay", "sparsity")}
        whole = {name: values[name] for name in ("steps", "curve_every", "scenes_per_step", "copies", "across")}
        return cls(**numbers, **whole, jitter=Jitter(**{name: float(x) for name, x in values["jitter"].items()}))


def maxent(regret: Float[Tensor, "scene path"], valid: Bool[Tensor, "scene path"]) -> Float[Tensor, ""]:
    """-log p(z_theta | I) of the valid demonstrations [nat], relative to uniform: mean over them.

    p is proportional to exp(return), so its logarithm is the soft regret: the lattice's sum is the partition.
    """
    return -regret[valid].mean()


def ranked(regret: Float[Tensor, "scene path"], valid: Bool[Tensor, "scene path"], across: bool) -> Float[Tensor, ""]:
    """-log sigmoid(valid's regret - invalid's) [nat]: mean over pairs of a scene, or of all scenes if `across`."""
    if across:
        margin = regret[valid][:, None] - regret[~valid][None, :]
        return F.softplus(-margin).mean()
    margin = regret[:, :, None] - regret[:, None, :]  # (scene, better, worse)
    pairs = valid[:, :, None] & ~valid[:, None, :]
    return F.softplus(-margin[pairs]).mean()


def fit(
    model: RewardMap,
    images: UInt8[Array, "scene 100 100 3"],
    z_theta: Float[Array, "scene n 2"],
    valid: Bool[Array, "scene n"],
    objective: str,
    schedule: Schedule,
    seed: int,
    checkpoints: Checkpoints | None = None,
) -> Float[Array, "point 2"]:
    """Train `model` in place on n demonstrations [m] a scene; the learning curve (columns `CURVE`) comes back.

    Demonstrations that are all valid, or all invalid, leave nothing to rank and no threshold to fit: the model then
    stays untrained and accepts with Laplace's probability (N valid + 1) / (N + 2), whatever the image and path.
    `checkpoints` keeps the weights on the way, each time with the rule that fits them.
    """
    if is_constant(valid):
        p = rule_of_succession(valid)
        accept(model, 0.0, float(np.log(p / (1 - p))))
        return np.array([[0.0, 0.0]])
    looks = _looks(images.tobytes(), schedule.copies, schedule.jitter)

    rng, checkpoints = np.random.default_rng(seed), checkpoints or Checkpoints()
    curve = _descend(model, rng, looks, z_theta, valid, objective, schedule, checkpoints)
    _settle(model, looks, z_theta, valid)
    return curve


@lru_cache(maxsize=1)  # all models of a training set see the same looks
def _looks(images: bytes, copies: int, jitter: Jitter) -> Float[Tensor, "copy scene 100 100 4"]:
    """Contrast of the training scenes, drawn from their pixels alone, in `copies` looks; the first is as they are."""
    rng = np.random.default_rng(crc32(images))
    scenes = np.frombuffer(images, np.uint8).reshape(-1, SIDE, SIDE, 3)
    plain, whitening = subtract_background(to_tensor(scenes.copy()))
    looks = [contrast(plain, whitening)]
    labels = blobs(looks[0][:, 0].sinh().numpy())
    for _ in range(copies - 1):
        painted, table = new_looks(rng, plain.numpy(), labels, jitter)
        looks.append(contrast(torch.from_numpy(painted), whitening[torch.from_numpy(table)]))
    return torch.stack(looks).permute(0, 1, 3, 4, 2).contiguous()  # colours last: quick to pick


def _descend(model, rng, looks, z_theta, valid, objective, schedule, checkpoints) -> Float[Array, "point 2"]:
    """The gradient descent: each step sees some scenes, each in one look, all under one symmetry."""
    z = torch.from_numpy(z_theta.astype(np.float32))
    labels = torch.tensor(valid)
    optimiser, cycle = schedule.optimiser(model.parameters())
    curve = []
    model.train()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**62)))  # dropout draws from torch's global generator
        for step in range(schedule.steps):
            if step in checkpoints.steps:
                _settle(model.eval(), looks, z_theta, valid)
                checkpoints.keep(step, model.train())
            scene = torch.from_numpy(rng.permutation(len(z))[: schedule.scenes_per_step])
            copy = torch.from_numpy(rng.integers(len(looks), size=len(scene)))
            symmetry = int(rng.integers(SYMMETRIES))
            seen = looks.flatten(0, 1).index_select(0, copy * len(z) + scene).permute(0, 3, 1, 2)
            batch = transform(seen, symmetry).contiguous(memory_format=torch.channels_last)
            reward = untransform(model.reward(batch), symmetry)
            regret = model.soft_regret(reward, z[scene])
            loss = _loss(objective, regret, labels[scene], schedule.across)
            if loss is not None:
                optimiser.zero_grad()
                (loss + schedule.sparsity * reward.abs().mean()).backward()
                optimiser.step()
            cycle.step()
            if loss is not None and (step % schedule.curve_every == 0 or step == schedule.steps - 1):
                curve.append((step, float(loss.detach())))
    model.eval()
    return np.array(curve).reshape(-1, len(CURVE))  # no point where demonstrations allow no pair


def _loss(objective, regret, valid, across) -> Tensor | None:
    """The objective on a batch; None if the batch holds nothing it could learn from."""
    if objective == "maxent":
        return maxent(regret, valid) if valid.any() else None
    pairs = valid.any() and not valid.all() if across else (valid.any(1) & ~valid.all(1)).any()
    return ranked(regret, valid, across) if pairs else None


def _settle(model, looks, z_theta, valid) -> None:
    """Fit the acceptance rule to the labels; half the looks do as well as all (docs/choices.md, "IRL")."""
    regrets = _regrets(model, looks[::2], z_theta)
    accept(model, *logistic(regrets, np.broadcast_to(valid, regrets.shape)))


@torch.no_grad()
def _regrets(model, looks, z_theta) -> Float[Array, "copy scene n"]:
    """Soft regret of the training demonstrations in these looks of their scenes, by the trained model."""
    z = torch.from_numpy(z_theta.astype(np.float32))
    accept(model, 1.0, 0.0)
    return torch.stack([model.logit(model.look(x.permute(0, 3, 1, 2)), z) for x in looks]).numpy()


def accept(model: RewardMap, scale: float, offset: float) -> None:
    """Set the acceptance rule: log-odds = scale * soft regret + offset."""
    model.scale.fill_(scale)
    model.offset.fill_(offset)


def logistic(regret: Float[Array, "*demo"], valid: Bool[Array, "*demo"]) -> tuple[float, float]:
    """Scale (at least 0) and offset of P(valid) = sigmoid(scale * regret + offset) by maximum likelihood.

    The targets are Platt's (1999), a little inside 0 and 1, so that separable labels give a finite scale. Newton's
    method on standardised regret, damped until the likelihood rises; concave, so it ends at the maximum.
    """
    x, y = regret.ravel().astype(np.float64), valid.ravel()
    target = np.where(y, (y.sum() + 1) / (y.sum() + 2), 1 / ((~y).sum() + 2))
    mean, spread = x.mean(), max(x.std(), 1e-9)
    design = np.stack([(x - mean) / spread, np.ones_like(x)], axis=1)  # (demo, 2)
    w = np.zeros(2)

    def loss(w: Array) -> float:
        return float((np.logaddexp(0, design @ w) - target * (design @ w)).sum())

    for _ in range(100):
        p = expit(design @ w)
        gradient = design.T @ (p - target)
        hessian = (design * (p * (1 - p))[:, None]).T @ design + 1e-9 * np.eye(2)
        step = np.linalg.solve(hessian, gradient)
        while loss(w - step) > loss(w) and np.abs(step).max() > 1e-12:
            step /= 2
        w = w - step
        if np.abs(step).max() < 1e-10:
            break
    scale = max(w[0], 0.0) / spread
    return scale, float(w[1] - scale * mean) if w[0] > 0 else float(np.log(target.mean() / (1 - target.mean())))
