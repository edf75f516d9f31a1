"""Identify the user behind labelled paths by a posterior over known users.

A user's model gives P_u(V = 1) for every path of a scene. Under a uniform prior over users,

    P(u | v_1..v_k) is proportional to the product over i of P_u(V = v_i | scene, z_i).

All functions depend only on these probabilities and on labels. With the true validities, 0 or 1, they give the ideal
observer: the users that contradict no label share the posterior.
"""

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array


def posterior(
    p: Float[Array, "user *b path"], valid: Bool[Array, "*#b path"], floor: float
) -> Float[Array, "user *b path"]:
    """Return P(u | v_1..v_k) for k = 1, 2, ... along the last axis; p is clipped to [floor, 1 - floor]."""
    p = np.clip(np.asarray(p, dtype=np.float64), floor, 1 - floor)
    log_likelihood = np.log(np.where(valid, p, 1 - p)).cumsum(-1)
    likelihood = np.exp(log_likelihood - log_likelihood.max(0))
    return likelihood / likelihood.sum(0)


def identify(
    p: Float[Array, "user seed scene draw path"], valid: Bool[Array, "user scene draw path"], floor: float
) -> Float[Array, "user path seed scene"]:
    """Return the accuracy of the most probable user after 1, 2, ... paths.

    First axis of the result: the true user. Draws are averaged; tied users share the credit.
    """
    belief = np.stack([posterior(p, labels, floor) for labels in valid])  # (true user, user, seed, scene, draw, path)
    best = belief == belief.max(1, keepdims=True)
    right = np.stack([of_user[user] / of_user.sum(0) for user, of_user in enumerate(best)])
    return np.moveaxis(right.mean(-2), -1, 1)
