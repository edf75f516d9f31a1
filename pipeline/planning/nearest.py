"""Find the nearest path that is valid according to a model or to the true rule (the oracle); the search is the same."""

from collections.abc import Callable

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from numpy import ndarray as Array
from torch import Tensor

from pipeline.models.base import Images, ValidityModel
from pipeline.perception.objects import Objects
from pipeline.world.bezier import Z_HIGH, Z_LOW, lattice
from pipeline.world.layout import Layouts
from pipeline.world.rules import Margins, clearance, slack, valid

REFINED_STEPS = 1.5  # half-width of a finer lattice around the best z, in steps of the coarser one
REFINEMENT = 4  # factor by which each refinement divides the step
SLACK_CAP_M = 0.1  # slack counts up to this value when ties of the constant detour are broken

Z = Float[Array, "start 2"]  # z_theta [m]
LogValid = Callable[[int, Float[Array, "path 2"]], Float[Array, " path"]]  # log P(valid) of paths [m] in that scene


def nearest(
    log_valid: LogValid, scenes: Int[Array, " start"], starts: Z, distance_penalty: float, side: int, refinements: int
) -> tuple[Z, Float[Array, " start"]]:
    """Return for each start the z_theta [m] with the highest log P(valid) - distance_penalty * distance, and its log P.

    `scenes` holds the scene index of each start. All starts of a scene share a lattice of `side` x `side` z_theta; each
    start then refines its best point `refinements` times, to (Z_HIGH - Z_LOW) / side / REFINEMENT**refinements. The
    search can miss regions thinner than the first lattice's step. A start stays if no candidate has a higher score.
    distance_penalty [1/m]: the gain in log P(valid) required per metre. If `log_valid` is 0 or -inf, any positive
    penalty gives the nearest valid path.
    """
    ends, log_p_ends = np.array(starts, dtype=np.float64), np.zeros(len(starts))
    coarse = lattice(side)
    count = int(REFINED_STEPS * REFINEMENT)
    offsets = np.arange(-count, count + 1) / REFINEMENT  # offsets of a finer lattice, in steps of the coarser one
    around = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    for scene in np.unique(scenes).tolist():
        z0 = ends[scenes == scene]
        best, log_p, each = z0, log_valid(scene, z0), np.arange(len(z0))
        for level in range(-1, refinements):
            score = log_p - distance_penalty * np.linalg.norm(best - z0, axis=-1)
            if (score >= 0).all():
                break  # no log P(valid) is higher
            if level < 0:
                candidates = np.broadcast_to(coarse, (len(z0), *coarse.shape))  # (start, candidate, 2)
                log_p_candidates = np.broadcast_to(log_valid(scene, coarse), candidates.shape[:2])
                cost = distance_penalty * np.linalg.norm(candidates - z0[:, None], axis=-1)
            else:
                candidates = best[:, None] + around * (Z_HIGH - Z_LOW) / side / REFINEMENT**level
                inside = ((candidates >= Z_LOW) & (candidates <= Z_HIGH)).all(-1)
                cost = distance_penalty * np.linalg.norm(candidates - z0[:, None], axis=-1)
                possible = inside & (-cost > score[:, None])  # log P(valid) <= 0: no other candidate can improve
                log_p_candidates = np.full(candidates.shape[:2], -np.inf)
                if possible.any():
                    log_p_candidates[possible] = log_valid(scene, candidates[possible])
            chosen = (log_p_candidates - cost).argmax(1)
            better = log_p_candidates[each, chosen] - cost[each, chosen] > score
            best = np.where(better[:, None], candidates[each, chosen], best)
            log_p = np.where(better, log_p_candidates[each, chosen], log_p)
        ends[scenes == scene], log_p_ends[scenes == scene] = best, log_p
    return ends, log_p_ends


@torch.no_grad()
def by_model(model: ValidityModel, images: Images | Objects) -> LogValid:
    """Return a model's log P(valid) in these scenes; the model perceives each scene once."""
    return by_percept(model, model.eval().see(images))


def by_percept(model: ValidityModel, percept: Tensor) -> LogValid:
    """Return a model's log P(valid) in scenes that it, or another detector, has perceived."""

    @torch.no_grad()
    def log_valid(scene: int, z: Array) -> Array:
        logit = model.logit(percept[scene : scene + 1], torch.as_tensor(z, dtype=torch.float32)[None])
        return F.logsigmoid(logit)[0].double().numpy()

    return log_valid


def nearest_valid(
    layouts: Layouts, z_theta: Float[Array, "scene start 2"], margins: Margins, side: int, refinements: int
) -> Float[Array, "scene start 2"]:
    """Return the truly valid z_theta nearest to each start [m], at the resolution of `nearest`.

    A start stays if it is valid, or if no lattice point is.
    """
    scenes = np.repeat(np.arange(len(layouts)), z_theta.shape[1])
    starts = np.asarray(z_theta, dtype=np.float64).reshape(-1, 2)

    def log_valid(scene: int, z: Array) -> Array:
        return np.where(valid(layouts[scene : scene + 1], z[None], margins)[0], 0.0, -np.inf)

    ends, _ = nearest(log_valid, scenes, starts, 1.0, side, refinements)
    return ends.reshape(z_theta.shape)


def constant_detour(layouts: Layouts, margins: Margins, side: int) -> Float[Array, "2"]:
    """Return the z_theta [m] of a lattice that is truly valid in most scenes.

    Ties go to the largest mean slack, clipped to +-SLACK_CAP_M.
    """
    z = lattice(side)
    slacks = slack(layouts, clearance(layouts, np.broadcast_to(z, (len(layouts), *z.shape))), margins)
    mean_slack = slacks.clip(-SLACK_CAP_M, SLACK_CAP_M).mean(0)
    return z[np.lexsort((mean_slack, (slacks > 0).mean(0)))[-1]]
