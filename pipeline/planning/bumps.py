"""Smooth displacements of any curve: the space in which curves are repaired and the nearest valid one is searched.

A displaced curve is its points plus a Bezier curve of degree DEGREE in the share of the length. The control points of
this are the displacement's offsets. Without the first and the last of them the ends stay; free ends move, too.
"""

import numpy as np
from jaxtyping import Float
from scipy.stats import norm, qmc

from pipeline.planning.nearest import LogValid
from pipeline.world.bezier import bernstein

Array = np.ndarray
DEGREE, POINTS = 5, 161  # points evenly along a curve, as the clearance model reads it
CANDIDATES, FIRST_M, ROUNDS = 512, 0.35, 8  # displacements that a search tries at once; each round tries half as far


def basis(free_ends: bool = False) -> Float[Array, "point offset"]:
    """Return how far each offset moves each of POINTS points."""
    moves = bernstein(np.linspace(0, 1, POINTS), DEGREE)
    return moves if free_ends else moves[:, 1:-1]


def displacement(offsets: Float[Array, "*curve offset 2"]) -> Array | np.floating:
    """Return for each curve the mean distance [m] along the curve between the points before and after."""
    moves = basis(free_ends=offsets.shape[-2] > DEGREE - 1)
    return np.linalg.norm(moves @ offsets, axis=-1).mean(-1)


def nearest(
    log_valid: LogValid,
    scene: int,
    start: Float[Array, "point 2"],
    distance_penalty: float,
    free_ends: bool = False,
) -> tuple[Float[Array, "offset 2"], float]:
    """Return the offsets [m] with the highest log P(valid) - distance_penalty * displacement, and their log P.

    start: POINTS points evenly along a curve [m]; log_valid, distance_penalty [1/m]: as in `planning.nearest.nearest`.
    The candidates of each round are quasi-random around the best one so far, half as far as in the round before; the
    search can miss narrow gaps. The start stays if no candidate is better.
    """
    b = basis(free_ends)
    draws = qmc.Sobol(2 * b.shape[1], seed=0).random(CANDIDATES)
    shapes = norm.ppf(draws.clip(1e-6, 1 - 1e-6)).reshape(CANDIDATES, -1, 2)
    best, log_p = np.zeros_like(shapes[0]), float(log_valid(scene, start[None])[0])
    for spread in FIRST_M * 0.5 ** np.arange(ROUNDS):
        candidates = np.concatenate([best + spread * shapes, best * np.linspace(0, 1, 16)[:, None, None]])
        cost = np.asarray(distance_penalty * displacement(candidates))
        score = log_p - distance_penalty * displacement(best)
        possible = -cost > score  # log P(valid) <= 0
        if not possible.any():
            continue
        log_p_of = np.full(len(candidates), -np.inf)
        log_p_of[possible] = log_valid(scene, start + b @ candidates[possible])
        chosen = int((log_p_of - cost).argmax())
        if log_p_of[chosen] - cost[chosen] > score:
            best, log_p = candidates[chosen], float(log_p_of[chosen])
    return best, log_p
