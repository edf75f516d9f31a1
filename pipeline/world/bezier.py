"""Quadratic Bezier paths between the two fixed ends of the task (Section "Dataset" of the paper).

A path is its central control point z_theta [m]; P_INIT and P_F are the same for every path.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

P_INIT = np.array([0.08, 0.08])  # bottom left of the table [m]
P_F = np.array([0.92, 0.92])  # top right of the table [m]
Z_LOW, Z_HIGH = -0.2, 1.2  # range of each coordinate of a random z_theta [m]


def basis(t: Float[Array, "*t"]) -> Float[Array, "*t 3"]:
    """Return the Bernstein polynomials of degree 2 at parameters `t` in [0, 1]."""
    return np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=-1)


def curve(z_theta: Float[Array, "*path 2"], samples: int) -> Float[Array, "*path samples 2"]:
    """Return the points [m] of each path at `samples` evenly spaced parameters, both ends included."""
    b = basis(np.linspace(0.0, 1.0, samples))  # (samples, 3)
    ends = b[:, :1] * P_INIT + b[:, 2:] * P_F  # (samples, 2)
    return ends + b[:, 1:2] * z_theta[..., None, :]


def random_z_theta(rng: np.random.Generator, *shape: int) -> Float[Array, "*shape 2"]:
    """Draw control points [m] uniform on [Z_LOW, Z_HIGH]^2."""
    return rng.uniform(Z_LOW, Z_HIGH, (*shape, 2))


def lattice(side: int) -> Float[Array, "cell 2"]:
    """Return the centres [m] of a `side` x `side` partition of the z_theta square; x varies fastest."""
    step = (Z_HIGH - Z_LOW) / side
    axis = Z_LOW + step * (np.arange(side) + 0.5)
    x, y = np.meshgrid(axis, axis)
    return np.stack([x.ravel(), y.ravel()], axis=-1)
