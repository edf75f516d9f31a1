"""Who showed these paths? The posterior over known users given the paths' labels, and a test that it is none of them.

A user's model gives the probability p that V = 1 for every path of a scene. Under a uniform prior

    P(u | v_1..v_k) is proportional to the product over i of P_u(V = v_i | scene, z_i).

Everything here is a function of p and of labels: no model, no image, no rule is known. Where p is the truth, 0 or 1,
the same functions are the ideal observer: the users that contradict no label share the posterior.
"""

from math import ceil, log

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

STEP = 0.25  # nats: surprises count in whole steps, so that their distribution is a finite sum
SURE = 0.99  # accuracy that counts as knowing who it was


def posterior(
    p: Float[Array, "user *b path"], valid: Bool[Array, "*#b path"], floor: float
) -> Float[Array, "user *b path"]:
    """P(u | v_1..v_k) for k = 1, 2, ... along the last axis; p is kept `floor` away from 0 and 1."""
    p = _bounded(p, floor)
    log_likelihood = np.log(np.where(valid, p, 1 - p)).cumsum(-1)
    likelihood = np.exp(log_likelihood - log_likelihood.max(0))
    return likelihood / likelihood.sum(0)


def identify(
    p: Float[Array, "user seed scene draw path"], valid: Bool[Array, "user scene draw path"], floor: float
) -> tuple[Float[Array, "user path seed scene"], Float[Array, "user path seed scene"]]:
    """How often the most probable user is the true one after 1, 2, ... labelled paths, and its mean probability.

    First axis of the result: the true user; draws are averaged. Users who tie share the credit, as if by lot.
    """
    right, sure = [], []
    for true, labels in enumerate(valid):
        belief = posterior(p, labels, floor)
        highest = belief.max(0)
        best = belief == highest
        right.append(best[true] / best.sum(0))  # (seed, scene, draw, path)
        sure.append(highest)
    return _by_path(np.stack(right)), _by_path(np.stack(sure))


def none_of_these(
    p: Float[Array, "user seed scene draw path"],
    valid: Bool[Array, "who scene draw path"],
    floor: float,
    level: float,
) -> Float[Array, "who path seed scene"]:
    """How often every user is rejected after 1, 2, ... labelled paths of each demonstrator; draws are averaged.

    If p is right about the demonstrator, "none of these" comes out with probability `level` at the most, at each k.
    """
    none = np.ones((len(valid), *p.shape[1:]), dtype=bool)
    for of_user in p:
        for seed, of_seed in enumerate(of_user):
            none[:, seed] &= rejected(of_seed, valid, floor, level)
    return _by_path(none)


def rejected(
    p: Float[Array, "*b path"], valid: Bool[Array, "who *b path"], floor: float, level: float
) -> Bool[Array, "who *b path"]:
    """Whether v_1..v_k fit p too badly, for k = 1, 2, ...: an exact test under independent V_i ~ Bernoulli(p_i).

    The statistic is log P(v_1..v_k), with |log-odds| rounded down to whole `STEP`s. Short of the rounding it is the
    likelihood ratio of the user against a coin, and no test is more powerful against a stranger as unpredictable as
    that (Neyman and Pearson). One-sided: labels that fit better than p promises speak against p, not against the user.
    """
    p = _bounded(p, floor)
    rare = np.minimum(p, 1 - p)
    weight = np.floor(np.log((1 - rare) / rare) / STEP).astype(int)
    surprise = np.where((p >= 0.5) != valid, weight, 0).cumsum(-1)
    return surprise >= critical_surprise(weight, rare, level)


def critical_surprise(
    weight: Int[Array, "*b path"], rare: Float[Array, "*b path"], level: float
) -> Int[Array, "*b path"]:
    """Least s with P(S_k >= s) <= level for k = 1, 2, ...: S_k sums the weights of those labels that come out rare.

    Each of the first k labels comes out rare with a probability of its own, and the distribution of S_k is built label
    by label. It is needed below a bound only: with exp(STEP weight) <= (1 - rare) / rare, as here, Markov's inequality
    gives P(S_k >= s) <= 2^k exp(-STEP s).
    """
    *shape, paths = weight.shape
    weight, rare = weight.reshape(-1, paths), rare.reshape(-1, paths)
    rows, cells, pad = np.arange(len(weight)), ceil((paths * log(2) - log(level)) / STEP), weight.max()
    padded = np.zeros((len(weight), pad + cells))
    mass = padded[:, pad:]  # P(S_k = s), s < cells
    moved = np.lib.stride_tricks.sliding_window_view(padded, cells, axis=1)  # [:, pad - w]: the mass moved up by w
    mass[:, 0] = 1.0
    critical = np.empty(weight.shape, dtype=int)
    for k in range(paths):
        mass += rare[:, k, None] * (moved[rows, pad - weight[:, k]] - mass)
        critical[:, k] = 1 + (1 - mass.cumsum(1) > level).sum(1)
    return critical.reshape(*shape, paths)


def telling(valid: Bool[Array, "user scene draw path"]) -> Bool[Array, " scene"]:
    """Scenes in which every user is `unlike` every other one."""
    return np.all([unlike(of_user, np.delete(valid, u, axis=0)) for u, of_user in enumerate(valid)], axis=0)


def unlike(valid: Bool[Array, "scene draw path"], others: Bool[Array, "user scene draw path"]) -> Bool[Array, " scene"]:
    """Scenes where these labels differ from each of the others' so often that one draw shows it with `SURE`."""
    differ = (valid != others).mean((-2, -1))  # (user, scene)
    return (1 - (1 - differ) ** valid.shape[-1] >= SURE).all(0)


def sure_from(accuracy: Float[Array, "path scene"]) -> int | None:
    """The least k from which accuracy, the mean over scenes, stays above `SURE`; None if the last one's is not."""
    failed = np.flatnonzero(accuracy.mean(1) <= SURE) if accuracy.size else np.array([len(accuracy) - 1])
    k = int(failed.max(initial=-1)) + 2
    return k if k <= len(accuracy) else None


def _bounded(p: Float[Array, "*b"], floor: float) -> Float[Array, "*b"]:
    return np.clip(np.asarray(p, dtype=np.float64), floor, 1 - floor)


def _by_path(values: Array) -> Float[Array, "who path seed scene"]:
    """(who, seed, scene, draw, path) averaged over draws, k first."""
    return np.moveaxis(values.mean(-2), -1, 1)
