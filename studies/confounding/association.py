"""Estimate the association between passing near an item and invalidity, from labelled paths without intervention."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array
from scipy.stats import t as student

from pipeline.stats.tests import LEVEL
from pipeline.world.layout import Layouts
from pipeline.world.rules import clearance


class Association(NamedTuple):
    """P(invalid | near) - P(invalid | not near) with a 95 % interval; NaN if undefined."""

    demonstrations: int
    near: int  # number of paths that pass near
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
    """Return the association between invalidity and passing near.

    Paths of a scene are dependent, scenes are independent. The standard error is the jackknife's over scenes (Efron and
    Stein, 1981), and the interval is Student's. It is undefined if, without some scene, all paths or none pass near.
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
