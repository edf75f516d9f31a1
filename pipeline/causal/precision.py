"""How finely the effects are known: what could have been detected, what would settle a verdict, and single seeds."""

from math import ceil, sqrt

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.special import stdtrit

from pipeline.causal.statistics import (
    LEVEL,
    SMALLEST_EFFECT,
    crossed_error,
    estimate,
    holm,
    mean_squares,
    rare,
    true_verdict,
    verdict,
    with_rare_scenes,
)  # fmt: skip

POWER = 0.8


def detectable(effects: Float[Array, "cell seed scene"]) -> Float[Array, " cell"]:
    """The smallest effect of each cell that is given the verdict "effect" with a chance of POWER.

    For that its estimate has to pass Holm's first, strictest step, and the smallest effect of interest.
    """
    error, freedom = crossed_error(with_rare_scenes(effects))
    needed = np.maximum(stdtrit(freedom, 1 - LEVEL / (2 * len(effects))) * error, SMALLEST_EFFECT)
    return needed + stdtrit(freedom, POWER) * error


def scenes_to_settle(effects: Float[Array, "cell seed scene"]) -> list[int | None]:
    """How many scenes each cell would need for a verdict, if its effect and its chances stayed as they are.

    The error over n scenes is nearly that of its variance components and of `with_rare_scenes`; None where the seeds
    alone keep it too wide.
    """
    cells, seeds, scenes = effects.shape
    by_seed, by_scene, rest = mean_squares(effects)
    of_seeds = np.maximum(by_seed - rest, 0.0) / (scenes * seeds)  # of the mean's variance, whatever the scenes
    per_scene = np.maximum(by_scene, rest) / seeds  # of one scene
    added = 2 * float(rare(effects)) ** 2  # v / n + added / n^2 is what n scenes leave of a scene's variance v
    size, (_, freedom) = np.abs(effects.mean((1, 2))), crossed_error(with_rare_scenes(effects))
    equivalent = (SMALLEST_EFFECT - size) / stdtrit(freedom, 0.95)
    found = size / stdtrit(freedom, 1 - LEVEL / (2 * cells))
    allowed = np.where(size > SMALLEST_EFFECT, found, equivalent) ** 2  # variance of the mean
    return [
        max(2, ceil((v + sqrt(v**2 + 4 * added * (most - s))) / (2 * (most - s)))) if most > s else None
        for v, most, s in zip(per_scene, allowed, of_seeds, strict=True)
    ]


def seed_by_seed(effects: Float[Array, "cell seed scene"], truth: Float[Array, " cell"]) -> int:
    """How many verdicts are right if every seed is asked alone, Holm over its own cells; of cell * seed."""
    right = 0
    for seed in range(effects.shape[1]):
        e = estimate(with_rare_scenes(effects[:, seed : seed + 1]))
        for i, (effect, p, low, high) in enumerate(zip(e.effect, holm(e.p), e.ci90_low, e.ci90_high, strict=True)):
            said = verdict(effect, p, low, high)
            right += said == true_verdict(truth[i]) and (said == "no effect" or np.sign(effect) == np.sign(truth[i]))
    return int(right)
