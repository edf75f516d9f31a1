"""Fit quadratic Bezier paths with fixed ends to many trajectories at once.

A path is q(u) = p_init + b u + a u^2 with b = 2 (z - p_init) and a = p_init - 2 z + p_f; only z_theta = z is free.
The fit minimises the orthogonal distances E(z) = sum_i min_u |x_i - q(u; z)|^2 / 2. The inner minimum is a root of a
cubic, tracked from step to step (reparametrisation). The outer minimum is found by Newton's method with the exact
Hessian of E after eliminating the parameters u (variable projection). Damping makes every step lower E.

A nearly straight trajectory does not determine z along its own direction. A small penalty, ANCHOR_WEIGHT times
|z - z_0|^2, then selects a solution. In z_0 equal shares of recorded and fitted length correspond. The penalty is
negligible for all other trajectories.

A call of scipy.optimize.least_squares per trajectory is simpler and gives the same residuals, but takes several hundred
times as long (bench/test_fit.py).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from scipy.spatial import KDTree

from pipeline.runtime.errors import InputError
from pipeline.world.bezier import P_F, P_INIT, bernstein, bezier

BATCH_ROWS = 256  # trajectories per batch: large arrays that still fit the cache
PAD_SAMPLES = 32  # lengths are padded to a multiple of this, so that rounding does not depend on the batch
MAX_STEPS = 200  # Newton steps; simulated trajectories take about eight
MAX_BRANCH_ROUNDS = 10  # rounds of moving samples to the nearest branch of a folded path; one or two suffice
TOLERANCE = 1e-8  # of E: stop when a step is predicted to lower E by less
ANCHOR_WEIGHT = 1e-6  # weight of |z - z_0|^2 relative to one sample's squared distance
LENGTH_ROUNDS = 10  # rounds of length matching for z_0; paths that fold back need several
LENGTH_STRIDE = 4  # use every fourth sample for length matching; it does not need more
LENGTH_POINTS = 65  # parameters at which a path's length is summed
MAX_PARAMETER_STEP = 0.1  # largest parameter step; near a turning point a longer step would leave the branch
BRANCH_STARTS = (0.0, 0.5, 1.0)  # parameters from which the nearest point is searched again
BRANCH_STEPS = 6  # Newton steps from each start
FOOT_POINTS, WINDOW = 513, 48  # of `fit_any`: points on the curve, and how far along it a sample moves in a round
FINE_POINTS = 4097  # of `fit_any`: on the curve from which the residual is measured
ROUNDS, ALONG = 16, 0.1  # of `fit_any`


@dataclass(frozen=True)
class Fits:
    """Fitted paths: control point [m], root mean square orthogonal distance [m], whether the fit is poor."""

    z_theta: Float[Array, "trajectory 2"]
    residual_m: Float[Array, " trajectory"]
    poor: Bool[Array, " trajectory"]


def fit(
    points: Float[Array, "total 2"],
    offsets: Int[Array, " bound"],
    poor_above_m: float,
    p_init: Float[Array, "*trajectory_or_all 2"] = P_INIT,
    p_f: Float[Array, "*trajectory_or_all 2"] = P_F,
) -> Fits:
    """Fit a path to each trajectory `points[offsets[i]:offsets[i + 1]]` [m], in time order.

    `p_init` and `p_f` are the fixed ends [m], one pair for all trajectories or one per trajectory. Fits with a residual
    above `poor_above_m` [m] are flagged `poor`, never dropped. Raises InputError for a trajectory with fewer than 3
    points.
    """
    lengths = np.diff(offsets)
    if len(lengths) and lengths.min() < 3:
        raise InputError(f"trajectory {lengths.argmin()} has {lengths.min()} points: expected at least 3; leave it out")
    start, end = (np.broadcast_to(p, (len(lengths), 2)).astype(float) for p in (p_init, p_f))
    z, residual = np.empty((len(lengths), 2)), np.empty(len(lengths))
    widths = -(-lengths // PAD_SAMPLES) * PAD_SAMPLES
    alike = [(width, np.nonzero(widths == width)[0]) for width in np.unique(widths)]
    for width, rows in [(w, x[i : i + BATCH_ROWS]) for w, x in alike for i in range(0, len(x), BATCH_ROWS)]:
        sample = np.arange(width)
        index = offsets[rows, None] + np.minimum(sample, lengths[rows, None] - 1)  # (row, sample)
        weight = (sample < lengths[rows, None]).astype(float)
        relative = np.stack([points[index, i] - start[rows, i, None] for i in (0, 1)])
        of_rows, residual[rows] = _Batch(relative, weight, (end - start)[rows].T).solve()
        z[rows] = of_rows.T
    return Fits(z + start, residual, residual > poor_above_m)


def fit_any(
    points: Float[Array, "sample 2"], degree: int
) -> tuple[Float[Array, "control 2"], Float[Array, " sample"], float]:
    """Fit a Bezier path of any degree and ends to one trajectory [m], in time order.

    Returns its control points [m], each sample's parameter, and the root mean square distance [m]. Each round finds the
    nearest points on the path, and then moves the control points by least squares of the distances from the tangents
    there; moves along the tangents cost ALONG times as much, so that steps stay short (Wang, Pottmann and Liu, 2006).
    The ends stay at the ends. Raises InputError for fewer samples than control points.
    """
    if len(points) <= degree:
        raise InputError(f"a trajectory has {len(points)} points: expected at least {degree + 1} for degree {degree}")
    u = _shares(np.hypot(*np.diff(points, axis=0).T)[None])[0]
    controls = np.linalg.lstsq(bernstein(u, degree), points, rcond=None)[0]
    best, offsets = (np.inf, controls, u), np.arange(-WINDOW, WINDOW + 1)
    along = np.r_[1.0, np.full(len(points) - 2, ALONG), 1.0]
    for _ in range(ROUNDS):
        fine = bezier(controls, FOOT_POINTS)
        near = (np.rint(u * (FOOT_POINTS - 1)).astype(int)[:, None] + offsets).clip(0, FOOT_POINTS - 1)
        away = np.linalg.norm(fine[near] - points[:, None], axis=-1)
        u = np.take_along_axis(near, away.argmin(1)[:, None], 1)[:, 0] / (FOOT_POINTS - 1)
        u[[0, -1]] = 0, 1
        b, miss = bernstein(u, degree), points - bernstein(u, degree) @ controls
        if (energy := float((away.min(1)[1:-1] ** 2).sum() + (miss[[0, -1]] ** 2).sum())) < best[0]:
            best = energy, controls, u
        heading = bernstein(u, degree - 1) @ np.diff(controls, axis=0)
        heading = heading / np.maximum(np.linalg.norm(heading, axis=1, keepdims=True), 1e-12)
        axes = np.stack([heading[:, ::-1] * [-1, 1], heading * along[:, None]])  # (across or along, sample, 2)
        design = (b[None, :, :, None] * axes[:, :, None]).reshape(2 * len(points), -1)
        step = np.linalg.lstsq(design, (miss * axes).sum(-1).ravel(), rcond=1e-9)[0]
        controls = controls + step.reshape(-1, 2)
    _, controls, u = best
    away = KDTree(bezier(controls, FINE_POINTS)).query(points)[0]
    return controls, u, float(np.sqrt((away**2).mean()))


class _Batch:
    """Trajectories relative to p_init, padded to one length with weight 0; rows do not affect each other.

    points: (axis, row, sample); weight and parameters u: (row, sample); end, anchor and z: (axis, row).
    """

    def __init__(self, points: Array, weight: Array, end: Array, anchor: Array | None = None):
        self.points, self.weight, self.end, self.count = points, weight, end, weight.sum(1)
        self.anchor = self.matched_lengths() if anchor is None else anchor  # z_0

    def __getitem__(self, rows: Array) -> "_Batch":
        return _Batch(self.points[:, rows], self.weight[rows], self.end[:, rows], self.anchor[:, rows])

    def solve(self) -> tuple[Array, Array]:
        """Return the control points (axis, row) and root mean square distances (row,) at the minimum of E."""
        z, u = self.descend(self.anchor.copy(), self.nearest(self.anchor, np.full_like(self.weight, 0.5)))
        rows = np.arange(len(u))
        for _ in range(MAX_BRANCH_ROUNDS):
            nearest = self[rows].nearest(z[:, rows], u[rows])
            wrong = (nearest != u[rows]).any(1)
            if not wrong.any():
                break  # every sample is assigned to the nearest branch of its path
            rows = rows[wrong]
            z[:, rows], u[rows] = self[rows].descend(z[:, rows], nearest[wrong])
        return z, np.sqrt((self.weight * (self.residual(z, u) ** 2).sum(0)).sum(1) / self.count)

    def matched_lengths(self) -> Array:
        """Return z_0 (axis, row): the fit in which samples divide the path as they divide the recorded length."""
        share = _shares(np.hypot(*np.diff(self.points)))[:, ::LENGTH_STRIDE]
        sparse = self.points[..., ::LENGTH_STRIDE], self.weight[:, ::LENGTH_STRIDE], self.end
        z, grid = _closed_form(*sparse, share), np.linspace(0.0, 1.0, LENGTH_POINTS)
        for _ in range(LENGTH_ROUNDS):
            speed = 2 * z[..., None] * (1 - 2 * grid) + 2 * self.end[..., None] * grid
            fitted = _shares(np.hypot(*speed)[:, 1:])
            z = _closed_form(
                *sparse, np.stack([np.interp(*of_row, grid) for of_row in zip(share, fitted, strict=True)])
            )
        return z

    def descend(self, z: Array, u: Array) -> tuple[Array, Array]:
        """Minimise E by damped Newton steps; return z (axis, row) and the parameters u (row, sample) at the minimum.

        Converged rows leave the batch.
        """
        batch, rows, end_z, end_u = self, np.arange(len(u)), np.empty_like(z), np.empty_like(u)
        u = self.foot_points(z, u, steps=4)
        energy, damping = self.energy(z, u), np.full(len(u), 1e-3)
        for _ in range(MAX_STEPS):
            step, gain = batch.newton(z, u, damping)
            to_u = batch.foot_points(z + step, u)
            to_energy = batch.energy(z + step, to_u)
            better = to_energy <= energy
            z, u = np.where(better, z + step, z), np.where(better[:, None], to_u, u)
            energy = np.where(better, to_energy, energy)
            damping = np.where(better, 0.1 * damping, 4 * damping + 1e-6)
            end_z[:, rows], end_u[rows] = z, u
            moving = gain > TOLERANCE * energy + 1e-30
            if not moving.any():
                break
            if not moving.all():
                batch, rows = batch[moving], rows[moving]
                z, u, energy, damping = z[:, moving], u[moving], energy[moving], damping[moving]
        return end_z, end_u

    def newton(self, z: Array, u: Array, damping: Array) -> tuple[Array, Array]:
        """Return a Newton step (axis, row) on E with u eliminated, and the decrease of E that it predicts (row,).

        The Hessian is shifted by `damping` (row,) times its scale, and further if it is still indefinite.
        """
        a, b1, residual = (self.end - 2 * z)[..., None], 2 * u * (1 - u), self.residual(z, u)
        tangent = 2 * a * u + 2 * z[..., None]  # q'(u)
        bend = (tangent**2).sum(0) - 2 * (residual * a).sum(0)
        inside = self.weight * ((u > 0) & (u < 1) & (bend > 0)) / np.where(bend > 0, bend, 1.0)
        mixed = b1 * tangent - (2 - 4 * u) * residual
        w1, anchor = self.weight * b1, ANCHOR_WEIGHT * self.count
        gx, gy = (w1 * residual).sum(-1) + anchor * (self.anchor - z)
        scale = (w1 * b1).sum(1) + anchor
        hxx, hyy = scale - (inside * mixed * mixed).sum(-1)
        hxy = -(inside * mixed[0] * mixed[1]).sum(1)
        lowest = 0.5 * (hxx + hyy) - np.hypot(0.5 * (hxx - hyy), hxy)
        shift = damping * scale + np.maximum(0.0, 1e-12 * scale - 2 * lowest)
        hxx, hyy = hxx + shift, hyy + shift
        det = hxx * hyy - hxy * hxy
        step = np.stack([(hyy * gx - hxy * gy) / det, (hxx * gy - hxy * gx) / det])
        return step, 0.5 * (step[0] * gx + step[1] * gy)

    def energy(self, z: Array, u: Array) -> Array:
        anchored = ANCHOR_WEIGHT * self.count * ((z - self.anchor) ** 2).sum(0)
        return 0.5 * ((self.weight * (self.residual(z, u) ** 2).sum(0)).sum(1) + anchored)

    def residual(self, z: Array, u: Array) -> Array:
        return self.points - ((self.end - 2 * z)[..., None] * u + 2 * z[..., None]) * u

    def foot_points(self, z: Array, u: Array, steps: int = 2) -> Array:
        """Take Newton steps towards the nearest points' parameters (row, sample): downhill, within [0, 1]."""
        k4, k3, k2, k1 = self.quartic(z)
        floor = 1e-3 * (k4 + abs(k3) + 1e-12)
        for _ in range(steps):
            slope = ((4 * k4 * u + 3 * k3) * u + 2 * k2) * u + k1
            bend = np.maximum(abs((12 * k4 * u + 6 * k3) * u + 2 * k2), floor)
            u = np.clip(u - np.clip(slope / bend, -MAX_PARAMETER_STEP, MAX_PARAMETER_STEP), 0.0, 1.0)
        return u

    def nearest(self, z: Array, u: Array) -> Array:
        """Return `u`, or the parameter on the path's other branch where that is nearer."""
        k4, k3, k2, k1 = self.quartic(z)
        best = u
        for start in BRANCH_STARTS:
            other = self.foot_points(z, np.full_like(u, start), steps=BRANCH_STEPS)
            distance, present = ((((k4 * v + k3) * v + k2) * v + k1) * v for v in (other, best))
            nearer = (distance < present - 1e-12) & (self.weight > 0)
            best = np.where(nearer, other, best)
        return best

    def quartic(self, z: Array) -> tuple[Array, Array, Array, Array]:
        """Return each sample's coefficients of |x - q(u)|^2 / 2 - |x|^2 / 2 in u^4, u^3, u^2 and u."""
        b, a = 2 * z, self.end - 2 * z
        aa, ab, bb = ((p * q).sum(0)[:, None] for p, q in ((a, a), (a, b), (b, b)))
        (along_x, along_y), along_b = a[..., None] * self.points, b[..., None] * self.points
        return 0.5 * aa, ab, 0.5 * bb - along_x - along_y, -along_b.sum(0)


def _shares(steps: Array) -> Array:
    """Return the share of the total length before each step and at the end: (row, step) -> (row, step + 1)."""
    passed = np.concatenate([np.zeros((len(steps), 1)), np.cumsum(steps, 1)], 1)
    return passed / np.maximum(passed[:, -1:], 1e-12)


def _closed_form(points: Array, weight: Array, end: Array, u: Array) -> Array:
    """Return the z (axis, row) that minimises the distances of samples at fixed parameters `u` (row, sample)."""
    b1 = 2 * u * (1 - u)
    weighted = b1 * weight
    norm = np.maximum((weighted * b1).sum(1), 1e-12)
    return (weighted * (points - u * u * end[..., None])).sum(-1) / norm
