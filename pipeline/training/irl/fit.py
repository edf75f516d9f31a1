"""Fit a reward map by inverse reinforcement learning, then an acceptance rule on its advantage.

`maxent`: maximum-entropy IRL on the valid demonstrations alone, the usual setting without negative examples (Ziebart
et al., 2008). z_theta is two-dimensional, so the partition function is an exact sum over a lattice.
`ranked`: every valid demonstration is preferred to every invalid one (Bradley and Terry, 1952), which uses the same
labels as the specification model. Both map advantage to P(valid) by a logistic fit on all labels.
"""

from collections.abc import Mapping
from functools import lru_cache, partial
from typing import Any
from zlib import crc32

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from scipy.optimize import root
from scipy.special import expit
from torch import Tensor

from pipeline.models.base import to_tensor
from pipeline.models.irl.reward_map import SYMMETRIES, RewardMap, contrast, transform, turned, untransform
from pipeline.perception.background import subtract_background
from pipeline.runtime.settings import Count
from pipeline.training.irl.augment import ColorJitter, augment_appearances, blobs
from pipeline.training.loop import Losses, Schedule, Trainer, fit_varied, minimise
from pipeline.world.layout import SIDE

CURVE = ("step", "total")  # columns of a learning curve


class IrlSchedule(Schedule):
    """Training settings of a reward map (conf/irl.yaml)."""

    scenes_per_step: Count  # drawn without replacement; a larger number than there are means all
    n_augmentations: Count  # versions of each training scene, including the original; drawn once
    color_jitter: ColorJitter


def trainer(variant: Mapping[str, Any], irl: Mapping[str, Any]) -> Trainer:
    """Return how a reward map (conf/variants) is fitted with the settings of conf/irl.yaml."""
    objective = variant["objective"]
    schedule = IrlSchedule.of({**irl, "steps": irl["steps"][objective]})
    return Trainer(RewardMap, partial(fit, objective=objective, schedule=schedule), CURVE, batch_size=None)


def maxent(advantage: Float[Tensor, "scene path"], valid: Bool[Tensor, "scene path"]) -> Float[Tensor, ""]:
    """Return the mean of -log p(z_theta | I) over the valid demonstrations [nat], relative to a uniform distribution.

    p is proportional to exp(return), so log p is the advantage, with the partition function summed over the lattice.
    """
    return -advantage[valid].mean()


def ranked(advantage: Float[Tensor, "scene path"], valid: Bool[Tensor, "scene path"]) -> Float[Tensor, ""]:
    """Return the mean of -log sigmoid(advantage of valid - advantage of invalid) [nat] over pairs of all scenes."""
    return F.softplus(-(advantage[valid][:, None] - advantage[~valid][None, :])).mean()


def fit(models, images, z_theta, valid, objective, schedule, seeds, checkpoints=None) -> list[Float[Array, "point 2"]]:
    """Train reward maps in place, one after the other; return their learning curves (`CURVE`).

    Arguments as in `fit_varied`; `objective`: maxent or ranked. Every checkpoint has its own acceptance rule.
    """

    def set_constant(model: RewardMap, p: float) -> tuple[float]:
        set_acceptance_rule(model, 0.0, float(np.log(p / (1 - p))))
        return (0.0,)

    def descend(*data) -> list[Float[Array, "point 2"]]:
        return [_fit(form, schedule, data[-1], *own) for own in zip(*data[:-1], strict=True)]

    form = {"maxent": maxent, "ranked": ranked}[objective]
    return fit_varied(descend, set_constant, models, images, z_theta, valid, seeds, checkpoints)


def _fit(objective, schedule, checkpoints, model, images, z_theta, valid, seed) -> Float[Array, "point 2"]:
    """Train a map: each step uses some scenes, each in one version, all under one random symmetry."""
    appearances = _appearances(images.tobytes(), schedule.n_augmentations, schedule.color_jitter)
    rng, z, labels = np.random.default_rng(seed), torch.from_numpy(z_theta.astype(np.float32)), torch.tensor(valid)

    def loss() -> Losses | None:
        scene = torch.from_numpy(rng.permutation(len(z))[: schedule.scenes_per_step])
        appearance = torch.from_numpy(rng.integers(len(appearances), size=len(scene)))
        symmetry = int(rng.integers(SYMMETRIES))
        contrasts = appearances.flatten(0, 1).index_select(0, appearance * len(z) + scene).permute(0, 3, 1, 2)
        batch = transform(contrasts, symmetry).contiguous(memory_format=torch.channels_last)
        advantage, own = model.advantage(untransform(model.reward(batch), symmetry), z[scene]), labels[scene]
        if not own.any() or (objective is ranked and own.all()):
            return None  # nothing to learn from
        total = objective(advantage, own)
        return total, [total]

    def fit_rule() -> None:
        fit_acceptance_rule(model.eval(), appearances, z, valid)
        model.train()

    model.train()
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(int(rng.integers(2**62)))  # dropout uses torch's global generator
        curve = minimise(loss, model.parameters(), schedule, partial(checkpoints.keep, [model], fit_rule))
    fit_acceptance_rule(model.eval(), appearances, z, valid)
    return curve.reshape(-1, len(CURVE))  # empty if the demonstrations allow no pair


@lru_cache(maxsize=1)  # all models of a training set use the same augmentations
def _appearances(images: bytes, n_augmentations: int, jitter: ColorJitter) -> Float[Tensor, "version scene 100 100 4"]:
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


@torch.no_grad()
def fit_acceptance_rule(model: RewardMap, appearances: Tensor, z: Tensor, valid: Bool[Array, "scene n"]) -> None:
    """Fit the acceptance rule to the labels; half of the versions suffice (docs/decisions/005-irl.md)."""
    set_acceptance_rule(model, 1.0, 0.0)  # log-odds that are the advantage
    seen = (model.perceive_turned(turned(of_version.permute(0, 3, 1, 2))) for of_version in appearances[::2])
    advantages = torch.stack([model.logit(percept, z) for percept in seen]).numpy()
    set_acceptance_rule(model, *logistic(advantages, np.broadcast_to(valid, advantages.shape)))


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

    def hessian(w: Array) -> Array:
        p = expit(w @ design)
        return (design * (p * (1 - p))) @ design.T / len(x)

    # the likelihood is concave: its gradient has one root
    w = root(lambda w: design @ (expit(w @ design) - target) / len(x), np.zeros(2), jac=hessian, tol=1e-12).x
    scale = max(w[0], 0.0) / spread
    return scale, float(w[1] - scale * mean) if w[0] > 0 else float(np.log(target.mean() / (1 - target.mean())))
