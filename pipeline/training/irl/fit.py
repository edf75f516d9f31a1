"""Fit a reward map by inverse reinforcement learning, then an acceptance rule on its advantage.

`maxent`: maximum-entropy IRL on the valid demonstrations alone, the usual setting without negative examples (Ziebart
et al., 2008). z_theta is two-dimensional, so the partition function is an exact sum over a lattice.
`ranked`: every valid demonstration is preferred to every invalid one (Bradley and Terry, 1952), which uses the same
labels as the specification model. Both map advantage to P(valid) by a logistic fit on all labels.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
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
from pipeline.training.loop import (
    Checkpoints,
    Losses,
    Schedule,
    fit_sequentially,
    is_constant,
    minimise,
    rule_of_succession,
)
from pipeline.training.sets import Trainer
from pipeline.world.layout import SIDE

CURVE = ("step", "total")  # columns of a learning curve


@dataclass(frozen=True)
class IrlSchedule(Schedule):
    """Training settings of a reward map (conf/irl.yaml)."""

    scenes_per_step: int  # drawn without replacement; a larger number than there are means all
    n_augmentations: int  # versions of each training scene, including the original; drawn once
    color_jitter: ColorJitter

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "IrlSchedule":
        """Return the schedule in conf/irl.yaml with the steps of one objective."""
        return cls(**{**values, "color_jitter": ColorJitter(**values["color_jitter"])})


def trainer(variant: Mapping[str, Any], irl: Mapping[str, Any]) -> Trainer:
    """Return how a reward map (conf/variants) is fitted with the settings of conf/irl.yaml."""
    schedule = IrlSchedule.of({**irl, "steps": irl["steps"][variant["objective"]]})
    fit_all = partial(fit_sequentially, fit, objective=variant["objective"], schedule=schedule)
    return Trainer(RewardMap, fit_all, CURVE, batch_size=None)


def maxent(advantage: Float[Tensor, "scene path"], valid: Bool[Tensor, "scene path"]) -> Float[Tensor, ""]:
    """Return the mean of -log p(z_theta | I) over the valid demonstrations [nat], relative to a uniform distribution.

    p is proportional to exp(return), so log p is the advantage, with the partition function summed over the lattice.
    """
    return -advantage[valid].mean()


def ranked(advantage: Float[Tensor, "scene path"], valid: Bool[Tensor, "scene path"]) -> Float[Tensor, ""]:
    """Return the mean of -log sigmoid(advantage of valid - advantage of invalid) [nat] over pairs of all scenes."""
    return F.softplus(-(advantage[valid][:, None] - advantage[~valid][None, :])).mean()


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
    """Train `model` in place on n demonstrations [m] per scene; return the learning curve (`CURVE`).

    If all labels are equal, there is nothing to rank and no threshold to fit. The model then stays untrained and
    answers Laplace's probability (valid + 1) / (all + 2) for every image and path. `checkpoints` keeps intermediate
    weights, each with its own acceptance rule.
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


@lru_cache(maxsize=1)  # all models of a training set use the same augmentations
def _appearances(
    images: bytes, n_augmentations: int, jitter: ColorJitter
) -> Float[Tensor, "appearance scene 100 100 4"]:
    """Return the contrast of all versions of the training scenes, originals first; the images alone decide them."""
    rng = np.random.default_rng(crc32(images))
    scenes = np.frombuffer(images, np.uint8).reshape(-1, SIDE, SIDE, 3)
    plain, whitening = subtract_background(to_tensor(scenes.copy()))
    appearances = [contrast(plain, whitening)]
    labels = blobs(appearances[0][:, 0].sinh().numpy())
    for _ in range(n_augmentations - 1):
        recoloured, table = augment_appearances(rng, plain.numpy(), labels, jitter)
        appearances.append(contrast(torch.from_numpy(recoloured), whitening[torch.from_numpy(table)]))
    return torch.stack(appearances).permute(0, 1, 3, 4, 2).contiguous()  # channels last: fast to index


def _descend(model, rng, appearances, z_theta, valid, objective, schedule, checkpoints) -> Float[Array, "point 2"]:
    """Train the map: each step uses some scenes, each in one version, all under one random symmetry."""
    z = torch.from_numpy(z_theta.astype(np.float32))
    labels = torch.tensor(valid)

    def loss() -> Losses | None:
        scene = torch.from_numpy(rng.permutation(len(z))[: schedule.scenes_per_step])
        appearance = torch.from_numpy(rng.integers(len(appearances), size=len(scene)))
        symmetry = int(rng.integers(SYMMETRIES))
        contrasts = appearances.flatten(0, 1).index_select(0, appearance * len(z) + scene).permute(0, 3, 1, 2)
        batch = transform(contrasts, symmetry).contiguous(memory_format=torch.channels_last)
        reward = untransform(model.reward(batch), symmetry)
        advantage = model.advantage(reward, z[scene])
        total = _objective(objective, advantage, labels[scene])
        return None if total is None else (total, [total])

    def fit_rule() -> None:
        fit_acceptance_rule(model.eval(), appearances, z_theta, valid)
        model.train()

    model.train()
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(int(rng.integers(2**62)))  # dropout uses torch's global generator
        curve = minimise(loss, model.parameters(), schedule, before_step=checkpoints.before_step([model], fit_rule))
    model.eval()
    return curve.reshape(-1, len(CURVE))  # empty if the demonstrations allow no pair


def _objective(objective, advantage, valid) -> Tensor | None:
    """Return the objective on a batch, or None if the batch holds nothing to learn from."""
    if objective == "maxent":
        return maxent(advantage, valid) if valid.any() else None
    return ranked(advantage, valid) if valid.any() and not valid.all() else None


def fit_acceptance_rule(model, appearances, z_theta, valid) -> None:
    """Fit the acceptance rule to the labels; half of the versions suffice (docs/decisions/005-irl.md)."""
    advantages = _advantages(model, appearances[::2], z_theta)
    set_acceptance_rule(model, *logistic(advantages, np.broadcast_to(valid, advantages.shape)))


@torch.no_grad()
def _advantages(model, appearances, z_theta) -> Float[Array, "appearance scene n"]:
    """Return the trained model's advantage of the training demonstrations in these versions of their scenes."""
    z = torch.from_numpy(z_theta.astype(np.float32))
    set_acceptance_rule(model, 1.0, 0.0)
    return torch.stack([model.logit(model.perceive_contrasts(x.permute(0, 3, 1, 2)), z) for x in appearances]).numpy()


def set_acceptance_rule(model: RewardMap, scale: float, offset: float) -> None:
    """Set the acceptance rule: log-odds = scale * advantage + offset."""
    model.scale.fill_(scale)
    model.offset.fill_(offset)


def logistic(advantage: Float[Array, "*demo"], valid: Bool[Array, "*demo"]) -> tuple[float, float]:
    """Return scale (at least 0) and offset of P(valid) = sigmoid(scale * advantage + offset) by maximum likelihood.

    The targets are Platt's (1999), slightly inside (0, 1), so that separable labels give a finite scale.
    """
    x, y = advantage.ravel().astype(np.float64), valid.ravel()
    target = np.where(y, (y.sum() + 1) / (y.sum() + 2), 1 / ((~y).sum() + 2))
    mean, spread = x.mean(), max(x.std(), 1e-9)
    design = np.stack([(x - mean) / spread, np.ones_like(x)])  # (2, demo)

    def gradient(w: Array) -> Array:
        return design @ (expit(w @ design) - target) / len(x)

    def hessian(w: Array) -> Array:
        p = expit(w @ design)
        return (design * (p * (1 - p))) @ design.T / len(x)

    w = root(gradient, np.zeros(2), jac=hessian, tol=1e-12).x  # the likelihood is concave: one stationary point
    scale = max(w[0], 0.0) / spread
    return scale, float(w[1] - scale * mean) if w[0] > 0 else float(np.log(target.mean() / (1 - target.mean())))
