"""Image-blind baselines: predictions without the image, which a model must beat to show that its image helps."""

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.world.bezier import Z_HIGH, Z_LOW

IMAGE_BLIND_BASELINES = NEAREST, POSITION = "nearest_demonstration", "position_only"  # names in result tables


def nearest_demonstration(
    z_demos: Float[Array, "scene demo 2"], valid_demos: Bool[Array, "scene demo"], z_theta: Float[Array, "scene path 2"]
) -> Float[Array, "scene path"]:
    """Return P(valid), 0 or 1: the label of the scene's demonstration nearest in z_theta [m] (the first if tied)."""
    distances = np.linalg.norm(z_theta[:, :, None] - z_demos[:, None], axis=-1)  # (scene, path, demo)
    return np.take_along_axis(valid_demos, distances.argmin(-1), axis=1).astype(np.float64)


def position_only(prior: Float[Array, "side side"], z_theta: Float[Array, "*path 2"]) -> Float[Array, "*path"]:
    """Return P(valid) of each z_theta [m] from the position prior, a grid [y, x] over the z_theta square."""
    side = len(prior)
    cells = np.floor((z_theta - Z_LOW) / (Z_HIGH - Z_LOW) * side).astype(int).clip(0, side - 1)
    return prior[cells[..., 1], cells[..., 0]]


def position_only_of_half(prior: Float[Array, "side side"], z_theta: Float[Array, "*path 2"]) -> Float[Array, "*path"]:
    """Return `position_only` for paths of which half are valid: above 1/2 where more are valid than on average."""
    return position_only(prior - prior.mean() + 0.5, z_theta)
