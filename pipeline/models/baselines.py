"""Predictions that never look at the image: what a model must beat before it can be said to see."""

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.world.bezier import Z_HIGH, Z_LOW

NULLS = NEAREST, POSITION = "nearest_demonstration", "position_only"  # what results call them


def nearest(
    z_demos: Float[Array, "scene demo 2"],
    valid_demos: Bool[Array, "scene demo"],
    z_theta: Float[Array, "scene path 2"],
) -> Float[Array, "scene path"]:
    """P(valid), 0 or 1, of the scene's demonstration whose z_theta [m] is nearest (the first, if tied)."""
    distance = np.linalg.norm(z_theta[:, :, None] - z_demos[:, None], axis=-1)  # (scene, path, demo)
    return np.take_along_axis(valid_demos, distance.argmin(-1), axis=1).astype(np.float64)


def position(prior: Float[Array, "side side"], z_theta: Float[Array, "*path 2"]) -> Float[Array, "*path"]:
    """P(valid) of each z_theta [m] by its cell of the position prior, [y, x] over the z_theta square."""
    side = len(prior)
    cell = np.floor((z_theta - Z_LOW) / (Z_HIGH - Z_LOW) * side).astype(int).clip(0, side - 1)
    return prior[cell[..., 1], cell[..., 0]]
