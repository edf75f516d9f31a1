"""Bezier paths: the paper's between the task's two fixed ends (Section "Dataset"), and of any degree and ends.

A path of the paper is given by its central control point z_theta [m], and all share the ends P_INIT and P_F. Any other
smooth path is given by all of its control points, the first and the last being its ends.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array
from scipy.special import comb

P_INIT = np.array([0.08, 0.08])  # p_init of the paper: bottom left of the table [m]
P_F = np.array([0.92, 0.92])  # p_f of the paper: top right of the table [m]
Z_LOW, Z_HIGH = -0.2, 1.2  # range of each coordinate of z_theta [m]: some control points lie off the table


def basis(t: Float[Array, "*t"]) -> Float[Array, "*t 3"]:
    """Return the three Bernstein polynomials of degree 2 at parameters `t` in [0, 1]."""
    return np.stack([(1 - t) ** 2, 2 * t * (1 - t), t**2], axis=-1)


def curve(z_theta: Float[Array, "*path 2"], samples: int) -> Float[Array, "*path samples 2"]:
    """Return the points [m] of each path at `samples` evenly spaced parameters, including both ends."""
    b = basis(np.linspace(0.0, 1.0, samples))  # (samples, 3)
    ends = b[:, :1] * P_INIT + b[:, 2:] * P_F  # (samples, 2)
    return ends + b[:, 1:2] * z_theta[..., None, :]


def bernstein(t: Float[Array, "*t"], degree: int) -> Float[Array, "*t control"]:
    """Return the Bernstein polynomials of a degree at parameters `t` in [0, 1]."""
    k = np.arange(degree + 1)
    return comb(degree, k) * t[..., None] ** k * (1 - t[..., None]) ** (degree - k)


def bezier(controls: Float[Array, "*path control 2"], samples: int) -> Float[Array, "*path samples 2"]:
    """Return the points [m] of each path at `samples` evenly spaced parameters, including both ends."""
    return bernstein(np.linspace(0.0, 1.0, samples), controls.shape[-2] - 1) @ controls


def elevated(controls: Float[Array, "control 2"], degree: int) -> Float[Array, "more 2"]:
    """Return the control points [m] of the same path as one of a higher degree, or of its own."""
    t = np.linspace(0, 1, 2 * degree + 1)
    return np.linalg.lstsq(bernstein(t, degree), bernstein(t, len(controls) - 1) @ controls, rcond=None)[0]


def random_z_theta(rng: np.random.Generator, *shape: int) -> Float[Array, "*shape 2"]:
    """Draw control points [m] uniformly on [Z_LOW, Z_HIGH]^2."""
    return rng.uniform(Z_LOW, Z_HIGH, (*shape, 2))


def lattice(side: int) -> Float[Array, "cell 2"]:
    """Return the cell centres [m] of a `side` x `side` grid over the z_theta square; x varies fastest."""
    step = (Z_HIGH - Z_LOW) / side
    axis = Z_LOW + step * (np.arange(side) + 0.5)
    x, y = np.meshgrid(axis, axis)
    return np.stack([x.ravel(), y.ravel()], axis=-1)
