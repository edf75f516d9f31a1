"""Find the nearest valid path: by what a model believes, or by what is true, with the same search."""

from collections.abc import Callable

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.models.base import ValidityModel, to_tensor
from pipeline.world.bezier import Z_HIGH, Z_LOW, lattice
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, valid

REFINED_STEPS = 1.5  # a finer lattice reaches this many of the coarser steps around the best z, on each axis
FINER = 4  # each refinement divides the step by this

LogValid = Callable[[int, Float[Array, "path 2"]], Float[Array, " path"]]
"""log P(valid) of paths [m] in the scene of that number."""


def nearest(
    log_valid: LogValid,
    scenes: Int[Array, " start"],
    starts: Float[Array, "start 2"],
    distance_penalty: float,
    side: int,
    refinements: int,
) -> Float[Array, "start 2"]:
    """Return for each start the z_theta [m] of the highest log P(valid) - distance_penalty * distance from it.

    `scenes` holds each start's scene. All starts of a scene share a lattice of `side` x `side` z_theta; each then
    refines its best one `refinements` times. The resolution is (Z_HIGH - Z_LOW) / side / FINER**refinements, and
    regions thinner than the first lattice's step can be missed. A start stays if nothing improves on it.
    distance_penalty [1/m]: the log P(valid) that a metre must bring. With a certain `log_valid`, 0 or -inf, any
    penalty above 0 gives the nearest valid path.
    """
    ends = np.array(starts, dtype=np.float64)
    coarse = lattice(side)
    step = (Z_HIGH - Z_LOW) / side
    count = int(REFINED_STEPS * FINER)
    offsets = np.arange(-count, count + 1) / FINER  # of a finer lattice, in steps of the coarser one
    around = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    for scene in np.unique(scenes):
        z0 = ends[scenes == scene]
        best, score = z0.copy(), log_valid(scene, z0)

        def improve(candidates: Array, log_p: Array, z0: Array = z0, best: Array = best, score: Array = score) -> None:
            """Move to the best of each start's candidates (start, candidate, 2) where it is an improvement."""
            scores = log_p - distance_penalty * np.linalg.norm(candidates - z0[:, None], axis=-1)
            chosen = scores.argmax(1)
            highest = np.take_along_axis(scores, chosen[:, None], 1)[:, 0]
            better = highest > score
            score[better] = highest[better]
            best[better] = np.broadcast_to(candidates, (len(z0), *candidates.shape[1:]))[better, chosen[better]]

        improve(coarse[None], log_valid(scene, coarse)[None])
        for level in range(refinements):
            candidates = best[:, None] + around * step / FINER**level  # (start, candidate, 2)
            inside = ((candidates >= Z_LOW) & (candidates <= Z_HIGH)).all(-1)
            cost = distance_penalty * np.linalg.norm(candidates - z0[:, None], axis=-1)
            possible = inside & (-cost > score[:, None])  # log P(valid) is at most 0: the others cannot be better
            log_p = np.full(candidates.shape[:2], -np.inf)
            if possible.any():
                log_p[possible] = log_valid(scene, candidates[possible])
            improve(candidates, log_p)
        ends[scenes == scene] = best
    return ends


def by_model(model: ValidityModel, images: UInt8[Array, "scene 100 100 3"]) -> LogValid:
    """Return a model's log P(valid) in these scenes, each of which it perceives once."""
    model.eval()
    with torch.no_grad():
        percept = model.perceive(to_tensor(images))

    def log_valid(scene: int, z: Array) -> Array:
        with torch.no_grad():
            logit = model.logit(percept[scene : scene + 1], torch.as_tensor(z, dtype=torch.float32)[None])
        return F.logsigmoid(logit)[0].double().numpy()

    return log_valid


def by_truth(layouts: Layouts, margins: Margins) -> LogValid:
    """Return a user's rule in these scenes: 0 for valid paths and -inf for the others."""

    def log_valid(scene: int, z: Array) -> Array:
        return np.where(valid(layouts[scene : scene + 1], z[None], margins)[0], 0.0, -np.inf)

    return log_valid
