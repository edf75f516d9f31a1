"""Time a path over the table with minimum jerk (Flash and Hogan, 1985), as the recordings are timed."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.world.bezier import P_F, P_INIT, basis, curve

ARC_POINTS = 257  # points by which a path's length is measured


def lengths(z_theta: Float[Array, "path 2"]) -> Float[Array, " path"]:
    """Return the length of each Bezier path [table sides]."""
    return np.linalg.norm(np.diff(curve(z_theta, ARC_POINTS), axis=1), axis=-1).sum(-1)


def minimum_jerk(z_theta: Float[Array, "path 2"], instants: int) -> Float[Array, "path instant 2"]:
    """Return the points [table sides] of each path at evenly spaced instants of a movement with minimum jerk."""
    tau = np.linspace(0.0, 1.0, instants)
    share = tau**3 * (10 - 15 * tau + 6 * tau**2)
    steps = np.linalg.norm(np.diff(curve(z_theta, ARC_POINTS), axis=1), axis=-1)
    passed = np.concatenate([np.zeros((len(steps), 1)), steps.cumsum(1)], 1)
    at = np.linspace(0.0, 1.0, ARC_POINTS)
    t = np.stack([np.interp(share, one / one[-1], at) for one in passed])
    b = basis(t)  # (path, instant, 3)
    return b[..., :1] * P_INIT + b[..., 1:2] * z_theta[:, None] + b[..., 2:] * P_F
