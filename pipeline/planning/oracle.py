"""References for repairs: the nearest truly valid path, and one detour for all scenes."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.planning.nearest import by_truth, nearest
from pipeline.world.bezier import lattice
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, clearance, slack

SLACK_CAP_M = 0.1  # slack counts up to this value when ties of the constant detour are broken


def nearest_valid(
    layouts: Layouts, z_theta: Float[Array, "scene start 2"], margins: Margins, side: int, refinements: int
) -> Float[Array, "scene start 2"]:
    """Return the truly valid z_theta nearest to each start [m], at the resolution of `nearest`.

    A start stays if it is valid, or if no lattice point is.
    """
    scenes = np.repeat(np.arange(len(layouts)), z_theta.shape[1])
    starts = np.asarray(z_theta, dtype=np.float64).reshape(-1, 2)
    ends, _ = nearest(by_truth(layouts, margins), scenes, starts, 1.0, side, refinements)
    return ends.reshape(z_theta.shape)


def constant_detour(layouts: Layouts, margins: Margins, side: int) -> Float[Array, "2"]:
    """Return the z_theta [m] of a lattice that is truly valid in most scenes.

    Ties go to the largest mean slack, clipped to +-SLACK_CAP_M.
    """
    z = lattice(side)
    by_scene = [layouts[i : i + 1] for i in range(len(layouts))]  # one at a time bounds the memory
    slacks = np.stack([slack(scene, clearance(scene, z[None]), margins)[0] for scene in by_scene])
    share = (slacks > 0).mean(0)
    mean_slack = slacks.clip(-SLACK_CAP_M, SLACK_CAP_M).mean(0)
    return z[np.lexsort((mean_slack, share))[-1]]
