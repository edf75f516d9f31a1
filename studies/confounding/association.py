"""Association: what labelled paths say of a symbol when nobody has intervened, and what confounding adds to blame."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from scipy.special import stdtrit

from pipeline.causal.interventions import DIGITS, expected_validity
from pipeline.stats.crossed import LEVEL, add_pseudo_scenes, estimate, holm
from pipeline.world.layout import Layouts
from pipeline.world.rules import clearance


def passes_near(
    layouts: Layouts, z_theta: Float[Array, "scene path 2"], symbol: int, near_m: float
) -> Bool[Array, "scene path"]:
    """Whether each path [m] comes within `near_m` of the footprint of an item of the symbol."""
    near = clearance(layouts, z_theta) < near_m  # (scene, path, slot)
    return (near & (layouts.symbol == symbol)[:, None]).any(-1)


def association(invalid: Bool[Array, "scene path"], near: Bool[Array, "scene path"]) -> dict:
    """P(invalid | near) - P(invalid | not near) over all paths, with a 95 % interval; None where it says nothing.

    Paths of a scene depend on one another, scenes do not: the interval is Student's around the difference, its error
    the jackknife's over scenes (Efron and Stein, 1981).
    """
    counts = np.stack([(x & w).sum(1) for w in (near, ~near) for x in (invalid, np.ones_like(invalid))])
    n = {"n_demos": int(invalid.size), "near": int(near.sum())}
    names = ("difference", "ci_low", "ci_high", "p_invalid_near", "p_invalid_far")
    without = counts.sum(1, keepdims=True) - counts  # (count, scene): every scene left out in turn
    if (without[[1, 3]] == 0).any():
        return dict.fromkeys(names) | n
    near_rate, far_rate = (float(counts[i].sum() / counts[i + 1].sum()) for i in (0, 2))
    difference = near_rate - far_rate
    left = without[0] / without[1] - without[2] / without[3]
    scenes = len(left)
    error = np.sqrt((scenes - 1) / scenes * ((left - left.mean()) ** 2).sum())
    reach = float(stdtrit(scenes - 1, 1 - LEVEL / 2) * error)
    values = (difference, difference - reach, difference + reach, near_rate, far_rate)
    return {name: round(value, DIGITS) + 0.0 for name, value in zip(names, values, strict=True)} | n


def shift(effects: Float[Array, "cell seed scene"], control: Float[Array, "cell seed scene"]) -> list[dict[str, float]]:
    """What is added to the effects of a control, seed by seed and scene by scene: one family of cells."""
    e = estimate(add_pseudo_scenes(effects - control))
    columns = {"difference": e.effect, "ci_low": e.ci_low, "ci_high": e.ci_high, "p_holm": holm(e.p)}
    return [
        {name: round(float(values[i]), DIGITS) + 0.0 for name, values in columns.items()} for i in range(len(effects))
    ]


def before_and_after(
    p: Float[Array, "user *seed table scene path"], ordinary: int, added: Sequence[int]
) -> tuple[Float[Array, "cell *seed scene"], Float[Array, "cell *seed scene"]]:
    """E[V] of the ordinary table and of each table with an added symbol, a cell per user and symbol."""
    expected = np.moveaxis(expected_validity(p), -2, 1)  # (user, table, ..., scene)
    after = expected[:, list(added)]
    before = np.broadcast_to(expected[:, [ordinary]], after.shape)
    return before.reshape(-1, *after.shape[2:]), after.reshape(-1, *after.shape[2:])
