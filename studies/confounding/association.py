"""Association between passing near an item and being invalid, estimated from labelled paths without intervention."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from scipy.stats import t as student

from pipeline.stats.crossed import LEVEL
from pipeline.world.layout import Layouts
from pipeline.world.rules import clearance


class Association(NamedTuple):
    """P(invalid | near) - P(invalid | not near) with a 95 % interval; NaN where it is undefined."""

    demonstrations: int
    near: int  # of them
    difference: float = np.nan
    ci_low: float = np.nan
    ci_high: float = np.nan
    p_invalid_near: float = np.nan
    p_invalid_far: float = np.nan


def passes_near(
    layouts: Layouts, z_theta: Float[Array, "scene path 2"], symbol: int, near_m: float
) -> Bool[Array, "scene path"]:
    """Return whether each path [m] comes within `near_m` [m] of the footprint of an item of the symbol."""
    near = clearance(layouts, z_theta) < near_m  # (scene, path, slot)
    return (near & (layouts.symbol == symbol)[:, None]).any(-1)


def association(invalid: Bool[Array, "scene path"], near: Bool[Array, "scene path"]) -> Association:
    """Return the association of being invalid with passing near.

    Paths of a scene depend on one another, scenes do not. So the standard error is the jackknife's over scenes (Efron
    and Stein, 1981) and the interval Student's. Undefined if, without some scene, all paths or none pass near.
    """
    count, near_count = invalid.size, int(near.sum())
    table = np.stack([(x & w).sum(1) for w in (near, ~near) for x in (invalid, np.ones_like(invalid))])
    without = table.sum(1, keepdims=True) - table  # (count, scene): each scene left out in turn
    if (without[[1, 3]] == 0).any():
        return Association(count, near_count)
    near_rate, far_rate = (float(table[i].sum() / table[i + 1].sum()) for i in (0, 2))
    difference, scenes = near_rate - far_rate, len(invalid)
    jackknife = without[0] / without[1] - without[2] / without[3]
    error = np.sqrt((scenes - 1) / scenes * ((jackknife - jackknife.mean()) ** 2).sum())
    half_width = float(student.ppf(1 - LEVEL / 2, scenes - 1) * error)
    interval = difference - half_width, difference + half_width
    return Association(count, near_count, difference, *interval, near_rate, far_rate)
