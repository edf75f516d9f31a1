"""Fit a reward map by inverse reinforcement learning, in two forms, and its acceptance rule afterwards.

`maxent`: maximum entropy IRL on the valid demonstrations alone, as a baseline without negative examples has it
(Ziebart et al., 2008). z_theta is two-dimensional, so the partition function is a sum over a lattice, not a sample.
`ranked`: every valid demonstration is preferred to every invalid one (Bradley and Terry, 1952), which uses the same
labels as the specification model. Both then turn soft regret into P(valid) by a logistic fit on all labels.
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
from scipy.optimize import root
from scipy.special import expit
from torch import Tensor

from pipeline.models.base import to_tensor
from pipeline.models.irl.reward_map import SYMMETRIES, RewardMap, contrast, transform, untransform
from pipeline.perception.background import subtract_background
from pipeline.training.irl.augment import ColorJitter, augment_appearances, blobs
from pipeline.training.loop import Checkpoints, Losses, Schedule, is_constant, minimise, rule_of_succession
from pipeline.world.layout import SIDE

OBJECTIVES = ("maxent", "ranked")
CURVE = ("step", "total")  # columns of a learning curve


@dataclass(frozen=True)
class IrlSchedule(Schedule):
    """How a reward map is trained (conf/irl)."""

    scenes_per_step: int  # drawn without replacement; more than there are: all
    n_augmentations: int  # appearances of each training scene, the scene as it is among them; drawn once
    sparsity: float  # weight of the mean absolute reward: no reward where nothing speaks for one
    across: bool  # rank over all scenes (soft regrets compare) or only within each
    color_jitter: ColorJitter

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "IrlSchedule":
        """Return the schedule of conf/irl with the variant's `steps`."""
        numbers = {name: float(values[name]) for name in ("rate", "weight_decay", "sparsity")}
        counts = {name: values[name] for name in ("steps", "curve_every", "scenes_per_step", "n_augmentations")}
        jitter = ColorJitter(**{name: float(value) for name, value in values["color_jitter"].items()})
        return cls(**numbers, **counts, across=values["across"], color_jitter=jitter)


def maxent(regret: Float[Tensor, "scene path"], valid: Bool[Tensor, "scene path"]) -> Float[Tensor, ""]:
    """Return -log p(z_theta | I) of the valid demonstrations [nat], relative to uniform: mean over them.

    p is proportional to exp(return), so its logarithm is the soft regret: the lattice's sum is the partition.
    """
    return -regret[valid].mean()


def ranked(regret: Float[Tensor, "scene path"], valid: Bool[Tensor, "scene path"], across: bool) -> Float[Tensor, ""]:
    """Return -log sigmoid(valid's regret - invalid's) [nat]: mean over a scene's pairs, or all if `across`."""
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
    schedule: IrlSchedule,
    seed: int,
    checkpoints: Checkpoints | None = None,
) -> Float[Array, "point 2"]:
    """Train `model` in place on n demonstrations [m] a scene and return the learning curve (`CURVE`).

    Labels that are all alike leave nothing to rank and no threshold to fit. The model then stays untrained and accepts
    with Laplace's probability (valid + 1) / (all + 2), whatever the image and path.
    `checkpoints` keeps the weights on the way, each time with the acceptance rule that fits them.
    """
    if is_constant(valid):
        p = rule_of_succession(valid)
        set_acceptance_rule(model, 0.0, float(np.log(p / (1 - p))))
        return np.array([[0.0, 0.0]])
    appearances = _appearances(images.tobytes(), schedule.n_augmentations, schedule.color_jitter)

    rng, checkpoints = np.random.default_rng(seed), checkpoints or Checkpoints()
    curve = _descend(model, rng, appearances, z_theta, valid, objective, schedule, checkpoints)
    fit_acceptance_rule(model, appearances, z_theta, valid)
    return curve


@lru_cache(maxsize=1)  # all models of a training set see the same appearances
def _appearances(
    images: bytes, n_augmentations: int, jitter: ColorJitter
) -> Float[Tensor, "appearance scene 100 100 4"]:
    """Return the training scenes' contrast in every appearance, the first as they are; drawn from the pixels alone."""
    rng = np.random.default_rng(crc32(images))
    scenes = np.frombuffer(images, np.uint8).reshape(-1, SIDE, SIDE, 3)
    plain, whitening = subtract_background(to_tensor(scenes.copy()))
    appearances = [contrast(plain, whitening)]
    labels = blobs(appearances[0][:, 0].sinh().numpy())
    for _ in range(n_augmentations - 1):
        recoloured, table = augment_appearances(rng, plain.numpy(), labels, jitter)
        appearances.append(contrast(torch.from_numpy(recoloured), whitening[torch.from_numpy(table)]))
    return torch.stack(appearances).permute(0, 1, 3, 4, 2).contiguous()  # channels last: quick to pick


def _descend(model, rng, appearances, z_theta, valid, objective, schedule, checkpoints) -> Float[Array, "point 2"]:
    """Train the map: each step sees some scenes, each in one appearance, all under one symmetry."""
    z = torch.from_numpy(z_theta.astype(np.float32))
    labels = torch.tensor(valid)

    def loss() -> Losses | None:
        scene = torch.from_numpy(rng.permutation(len(z))[: schedule.scenes_per_step])
        appearance = torch.from_numpy(rng.integers(len(appearances), size=len(scene)))
        symmetry = int(rng.integers(SYMMETRIES))
        contrasts = appearances.flatten(0, 1).index_select(0, appearance * len(z) + scene).permute(0, 3, 1, 2)
        batch = transform(contrasts, symmetry).contiguous(memory_format=torch.channels_last)
        reward = untransform(model.reward(batch), symmetry)
        regret = model.soft_regret(reward, z[scene])
        total = _objective(objective, regret, labels[scene], schedule.across)
        return None if total is None else (total + schedule.sparsity * reward.abs().mean(), [total])

    def fit_rule() -> None:
        fit_acceptance_rule(model.eval(), appearances, z_theta, valid)
        model.train()

    model.train()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**62)))  # dropout draws from torch's global generator
        curve = minimise(loss, model.parameters(), schedule, before_step=checkpoints.before_step([model], fit_rule))
    model.eval()
    return curve.reshape(-1, len(CURVE))  # no point where demonstrations allow no pair


def _objective(objective, regret, valid, across) -> Tensor | None:
    """Return the objective on a batch, or None if the batch holds nothing it could learn from."""
    if objective == "maxent":
        return maxent(regret, valid) if valid.any() else None
    pairs = valid.any() and not valid.all() if across else (valid.any(1) & ~valid.all(1)).any()
    return ranked(regret, valid, across) if pairs else None


def fit_acceptance_rule(model, appearances, z_theta, valid) -> None:
    """Fit the acceptance rule to the labels; half the appearances do as well as all (docs/decisions/005-irl.md)."""
    regrets = _regrets(model, appearances[::2], z_theta)
    set_acceptance_rule(model, *logistic(regrets, np.broadcast_to(valid, regrets.shape)))


@torch.no_grad()
def _regrets(model, appearances, z_theta) -> Float[Array, "appearance scene n"]:
    """Return the trained model's soft regret of the training demonstrations in these appearances of their scenes."""
    z = torch.from_numpy(z_theta.astype(np.float32))
    set_acceptance_rule(model, 1.0, 0.0)
    return torch.stack([model.logit(model.perceive_contrasts(x.permute(0, 3, 1, 2)), z) for x in appearances]).numpy()


def set_acceptance_rule(model: RewardMap, scale: float, offset: float) -> None:
    """Set the acceptance rule: log-odds = scale * soft regret + offset."""
    model.scale.fill_(scale)
    model.offset.fill_(offset)


def logistic(regret: Float[Array, "*demo"], valid: Bool[Array, "*demo"]) -> tuple[float, float]:
    """Return scale (at least 0) and offset of P(valid) = sigmoid(scale * regret + offset) by maximum likelihood.

    The targets are Platt's (1999), a little inside 0 and 1, so that separable labels give a finite scale.
    """
    x, y = regret.ravel().astype(np.float64), valid.ravel()
    target = np.where(y, (y.sum() + 1) / (y.sum() + 2), 1 / ((~y).sum() + 2))
    mean, spread = x.mean(), max(x.std(), 1e-9)
    design = np.stack([(x - mean) / spread, np.ones_like(x)])  # (2, demo)

    def gradient(w: Array) -> Array:
        return design @ (expit(w @ design) - target) / len(x)

    def hessian(w: Array) -> Array:
        p = expit(w @ design)
        return (design * (p * (1 - p))) @ design.T / len(x)

    w = root(gradient, np.zeros(2), jac=hessian, tol=1e-12).x  # the likelihood is concave: its one stationary point
    scale = max(w[0], 0.0) / spread
    return scale, float(w[1] - scale * mean) if w[0] > 0 else float(np.log(target.mean() / (1 - target.mean())))
