"""Identify the user behind labelled paths: a posterior over known users, and a test that it is none of them.

A user's model gives P_u(V = 1) for every path of a scene. Under a uniform prior over users,

    P(u | v_1..v_k) is proportional to the product over i of P_u(V = v_i | scene, z_i).

All functions depend only on these probabilities and on labels. With the true validities, 0 or 1, they give the ideal
observer: the users that contradict no label share the posterior.
"""

from math import ceil, log

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

STEP_NATS = 0.25  # surprises are rounded down to multiples of this, so that their distribution is a finite sum
Predicted, Labels = Float[Array, "user seed scene draw path"], Bool[Array, "user scene draw path"]
Rates = Float[Array, "who path seed scene"]  # by number of paths
DISTINCT = 0.99  # probability that a draw of paths distinguishes two users, from which they count as distinct


def posterior(
    p: Float[Array, "user *b path"], valid: Bool[Array, "*#b path"], floor: float
) -> Float[Array, "user *b path"]:
    """Return P(u | v_1..v_k) for k = 1, 2, ... along the last axis; p is clipped to [floor, 1 - floor]."""
    p = np.clip(np.asarray(p, dtype=np.float64), floor, 1 - floor)
    log_likelihood = np.log(np.where(valid, p, 1 - p)).cumsum(-1)
    likelihood = np.exp(log_likelihood - log_likelihood.max(0))
    return likelihood / likelihood.sum(0)


def identify(p: Predicted, valid: Labels, floor: float) -> Float[Array, "user path seed scene"]:
    """Return the accuracy of the most probable user after 1, 2, ... paths.

    First axis of the result: the true user. Draws are averaged; tied users share the credit.
    """
    belief = np.stack([posterior(p, labels, floor) for labels in valid])  # (true user, user, seed, scene, draw, path)
    best = belief == belief.max(1, keepdims=True)
    return _by_path(np.stack([of_user[user] / of_user.sum(0) for user, of_user in enumerate(best)]))


def reject_all_users(p: Predicted, valid: Bool[Array, "who scene draw path"], floor: float, level: float) -> Rates:
    """Return the rate at which every known user is rejected after 1, 2, ... paths of each demonstrator, over draws.

    If p is correct for the demonstrator, this happens with probability at most `level`, for each k.
    """
    rejected = [np.all([reject(x, valid, floor, level) for x in of_seed], axis=0) for of_seed in p.swapaxes(0, 1)]
    return _by_path(np.stack(rejected, axis=1))


def reject(
    p: Float[Array, "*b path"], valid: Bool[Array, "who *b path"], floor: float, level: float
) -> Bool[Array, "who *b path"]:
    """Return whether v_1..v_k contradict p, for k = 1, 2, ...: an exact test of independent V_i ~ Bernoulli(p_i).

    The statistic is log P(v_1..v_k), with |log-odds| rounded down to multiples of STEP_NATS. Up to rounding it is the
    likelihood ratio of the user against a fair coin (Neyman and Pearson). The test is one-sided: labels that fit better
    than p predicts are evidence against p, not against the user.
    """
    p = np.clip(np.asarray(p, dtype=np.float64), floor, 1 - floor)
    rare = np.minimum(p, 1 - p)
    weight = np.floor(np.log((1 - rare) / rare) / STEP_NATS).astype(int)
    surprise = np.where((p >= 0.5) != valid, weight, 0).cumsum(-1)
    return surprise >= critical_surprise(weight, rare, level)


def critical_surprise(
    weight: Int[Array, "*b path"], rare: Float[Array, "*b path"], level: float
) -> Int[Array, "*b path"]:
    """Return the smallest s with P(S_k >= s) <= level for k = 1, 2, ...

    S_k sums the weights of the improbable labels among the first k, each improbable with its own probability. The
    distribution is built label by label, up to a bound: since exp(STEP_NATS * weight) <= (1 - rare) / rare, Markov's
    inequality gives P(S_k >= s) <= 2^k exp(-STEP_NATS * s).
    """
    *shape, paths = weight.shape
    weight, rare = weight.reshape(-1, paths), rare.reshape(-1, paths)
    rows, bins, pad = np.arange(len(weight)), ceil((paths * log(2) - log(level)) / STEP_NATS), weight.max()
    padded = np.zeros((len(weight), pad + bins))
    mass = padded[:, pad:]  # P(S_k = s), s < bins
    shifted = np.lib.stride_tricks.sliding_window_view(padded, bins, axis=1)  # [:, pad - w]: the mass shifted up by w
    mass[:, 0] = 1.0
    critical = np.empty(weight.shape, dtype=int)
    for k in range(paths):
        mass += rare[:, k, None] * (shifted[rows, pad - weight[:, k]] - mass)
        critical[:, k] = 1 + (1 - mass.cumsum(1) > level).sum(1)
    return critical.reshape(*shape, paths)


def all_distinct(valid: Labels) -> Bool[Array, " scene"]:
    """Return the scenes in which any two users' labels differ so often that a draw shows it with chance DISTINCT."""
    differ = (valid[:, None] != valid).mean((-2, -1))  # (user, user, scene)
    distinct = 1 - (1 - differ) ** valid.shape[-1] >= DISTINCT
    return (distinct | np.eye(len(valid), dtype=bool)[..., None]).all((0, 1))


def _by_path(values: Array) -> Rates:
    """Return values (who, seed, scene, draw, path) averaged over draws, with the path axis second."""
    return np.moveaxis(values.mean(-2), -1, 1)
