"""What repairs are held against: the nearest truly valid path, and one detour for every scene."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.world.bezier import Z_HIGH, Z_LOW, lattice
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, clearance, slack, valid

REACH = 1.5  # a refinement looks so many of the coarser steps around the best z so far, on each axis
FINER = 4  # each refinement divides the step by this
SLACK_CAP = 0.1  # more room than this [m] no longer counts for the constant detour's choice


def nearest_valid(
    layouts: Layouts, z_theta: Float[Array, "scene start 2"], margins: Margins, side: int, refinements: int
) -> Float[Array, "scene start 2"]:
    """The truly valid z nearest to each start [m], inside the z_theta square.

    Nearest on a `side` x `side` lattice, then on ever finer ones around the best: no point of the coarse lattice
    is nearer, and the last step, (Z_HIGH - Z_LOW) / side / FINER**refinements, is the resolution. Regions thinner
    than the coarse step can be missed. A start stays where it is if it is valid, or if no point of the lattice is.
    """
    coarse = lattice(side)
    best = np.array(z_theta, dtype=np.float64)
    for scene in range(len(layouts)):  # one scene at a time bounds the memory
        layout = layouts[scene : scene + 1]
        allowed = coarse[valid(layout, coarse[None], margins)[0]]
        invalid = np.flatnonzero(~valid(layout, z_theta[scene : scene + 1], margins)[0])
        if len(allowed) == 0 or len(invalid) == 0:
            continue
        start = z_theta[scene, invalid]
        best[scene, invalid] = allowed[_distance(start[:, None], allowed).argmin(1)]
        for level in range(refinements):
            step = (Z_HIGH - Z_LOW) / side / FINER**level
            best[scene, invalid] = _refine(layout, start, best[scene, invalid], margins, step)
    return best


def _refine(layout: Layouts, start: Array, best: Array, margins: Margins, step: float) -> Array:
    """The nearest valid z on a lattice of `step / FINER` around each best one (itself included)."""
    count = int(REACH * FINER)
    axis = np.arange(-count, count + 1) * step / FINER
    x, y = np.meshgrid(axis, axis)
    near = best[:, None] + np.stack([x.ravel(), y.ravel()], axis=-1)  # (start, candidate, 2)
    distance = _distance(start[:, None], near)
    inside = ((near >= Z_LOW) & (near <= Z_HIGH)).all(-1)
    closer = inside & (distance <= _distance(start, best)[:, None])  # the rest needs no judging
    distance[~closer] = np.inf
    distance[closer] = np.where(valid(layout, near[closer][None], margins)[0], distance[closer], np.inf)
    return near[np.arange(len(start)), distance.argmin(1)]


def constant_detour(layouts: Layouts, margins: Margins, side: int) -> Float[Array, "2"]:
    """The one z_theta [m] of a lattice that is truly valid in most of the scenes, whatever they look like.

    Ties go to the one with the most room on average (slack, capped at SLACK_CAP either way).
    """
    z = lattice(side)
    room = np.stack([slack(one, clearance(one, z[None]), margins)[0] for one in _each(layouts)])  # (scene, lattice)
    share = (room > 0).mean(0)
    mean_room = room.clip(-SLACK_CAP, SLACK_CAP).mean(0)
    return z[np.lexsort((mean_room, share))[-1]]


def _each(layouts: Layouts) -> list[Layouts]:
    """Every scene as a batch of its own."""
    return [layouts[i : i + 1] for i in range(len(layouts))]


def _distance(a: Array, b: Array) -> Array:
    """Euclidean distance [m] over the last axis (broadcasting)."""
    return np.linalg.norm(a - b, axis=-1)
