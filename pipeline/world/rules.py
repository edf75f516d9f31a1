"""Decide which paths are valid to a user, the ground truth of the simulated world, and choose clear cases among them.

A user keeps a margin [m] from the footprint of every item whose symbol it avoids (paper, Section "Dataset").
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.world.bezier import curve
from pipeline.world.layout import SYMBOLS, Layouts, point_segment_distance, segment_distance

Margins = Mapping[str, float | None]  # symbol -> margin [m]; None: the user does not avoid this symbol
Clearances = Float[Array, "scene path slot"]  # [m]
PAPER_P_VALID = {  # Table 2 of the paper, to which the users' margins are calibrated
    "careful": {"none": 0.43, "bowl": 0.27, "plate": 0.28, "cutlery": 0.31, "glass": 0.30},
    "normal": {"none": 0.62, "bowl": 0.62, "plate": 0.63, "cutlery": 0.62, "glass": 0.48},
    "aggressive": {"none": 1.0, "bowl": 1.0, "plate": 1.0, "cutlery": 1.0, "glass": 1.0},
}
PATHS_AT_ONCE = 4000  # of several scenes, whose clearances are measured together
SAMPLES = 129  # points along a path; with `_smallest_distance`, clearances above 3 cm are exact within 0.4 mm


def line_clearance(layouts: Layouts, lines: Float[Array, "scene path point 2"]) -> Clearances:
    """Return the clearance [m] of polylines, with points at any spacing, from each footprint; inf in empty slots."""

    def away(lines: Float[Array, "scene path point 2"]) -> Callable[[Array], Array]:
        pieces = np.stack([lines[:, :, :-1], lines[:, :, 1:]], axis=-2)  # (scene, path, piece, end, 2)
        return lambda ends: segment_distance(pieces, ends).min(-1)

    return _clearances(layouts, lines, away)


def _clearances(layouts: Layouts, paths: Array, away: Callable[[Array], Callable[[Array], Array]]) -> Clearances:
    """Return the clearance of paths (scene, path, ...) from each footprint.

    away: paths -> segments (scene, 1, 1, 2, 2) -> distances (scene, path). Takes some scenes and one slot at a time, so
    that distances stay in the cache.
    """
    distances = np.empty((*paths.shape[:2], layouts.radius.shape[1]))
    step = max(1, PATHS_AT_ONCE // max(1, paths.shape[1]))
    for some in (slice(first, first + step) for first in range(0, len(layouts), step)):
        distance = away(paths[some])
        for slot, ends in enumerate(np.moveaxis(layouts.ends[some], 1, 0)):
            distances[some, :, slot] = distance(ends[:, None, None])
    return np.where(layouts.present[:, None], distances - layouts.radius[:, None], np.inf)


def _smallest_distance(distance: Float[Array, "*path point"]) -> Float[Array, "*path"]:
    """Return the least distance along a smooth path, from the parabola through the three smallest squared distances."""
    if distance.shape[-1] < 3:
        return distance.min(-1)
    square = distance**2
    middle = np.clip(square.argmin(-1), 1, square.shape[-1] - 2)[..., None]
    before, middle_square, after = (np.take_along_axis(square, middle + k, -1)[..., 0] for k in (-1, 0, 1))
    bend = np.maximum(before - 2 * middle_square + after, 1e-18)
    offset = np.clip(0.5 * (before - after) / bend, -1.0, 1.0)  # from the middle point to the vertex [points]
    return np.sqrt(np.maximum(middle_square - 0.5 * offset * (before - after) + 0.5 * offset**2 * bend, 0.0))


def clearance(layouts: Layouts, z_theta: Float[Array, "scene path 2"]) -> Clearances:
    """Return the clearance [m] of each Bezier path from each footprint: negative inside, inf in empty slots."""

    def away(z_theta: Float[Array, "scene path 2"]) -> Callable[[Array], Array]:
        points = curve(z_theta, SAMPLES)
        return lambda ends: _smallest_distance(point_segment_distance(points, ends[..., 0, :], ends[..., 1, :]))

    return _clearances(layouts, z_theta, away)


def slack(layouts: Layouts, clearances: Clearances, margins: Margins) -> Float[Array, "scene path"]:
    """Return each path's slack [m]: its smallest clearance in excess of the user's margins.

    Positive: the path is valid. inf: no item in the scene has a margin.
    """
    margin = np.array([np.inf if margins[s] is None else margins[s] for s in SYMBOLS] + [np.inf])
    required = np.where(layouts.present, margin[layouts.symbol], np.inf)[:, None, :]
    has_margin = np.isfinite(required)
    return np.where(has_margin, clearances - np.where(has_margin, required, 0.0), np.inf).min(-1)


def valid(layouts: Layouts, z_theta: Float[Array, "scene path 2"], margins: Margins) -> Bool[Array, "scene path"]:
    """Return whether each path is valid to the user: v in the paper."""
    return slack(layouts, clearance(layouts, z_theta), margins) > 0


@dataclass(frozen=True)
class Candidates:
    """Paths [m] in each scene of which clear cases are chosen, with their clearances [m] (`clearance`)."""

    layouts: Layouts
    z_theta: Float[Array, "scene candidate 2"]
    clearances: Float[Array, "scene candidate slot"]

    @classmethod
    def of(cls, layouts: Layouts, z_theta: Float[Array, "scene candidate 2"]) -> "Candidates":
        """Measure the clearances of all paths."""
        return cls(layouts, z_theta, clearance(layouts, z_theta))

    def choose(
        self, rng: np.random.Generator, margins: Margins, clear_m: float, count: int
    ) -> tuple[Float[Array, "scene path 2"], Bool[Array, "scene path"]]:
        """Choose `count` clear cases to the user in each scene (`clear_cases`); return them with their labels."""
        slacks = slack(self.layouts, self.clearances, margins)
        rows = np.stack([clear_cases(rng, of_scene, clear_m, count) for of_scene in slacks])
        return np.take_along_axis(self.z_theta, rows[..., None], 1), np.take_along_axis(slacks, rows, 1) > 0


def clear_cases(
    rng: np.random.Generator, slacks: Float[Array, " path"], clear_m: float, count: int
) -> Int[Array, " count"]:
    """Return the indices of different paths at least `clear_m` [m] from the boundary, each valid with probability 1/2.

    Where a scene has too few of one label, the other fills in; where it has too few of both, the clearest others.
    """
    valid, invalid = np.flatnonzero(slacks > clear_m), np.flatnonzero(slacks <= -clear_m)
    n_valid = np.clip(rng.binomial(count, 0.5), count - len(invalid), len(valid))
    chosen = np.concatenate([valid[:n_valid], invalid[: count - n_valid]])
    clearest = np.argsort(-np.abs(slacks), kind="stable")
    rest = clearest[~np.isin(clearest, chosen)][: count - len(chosen)]
    return rng.permutation(np.concatenate([chosen, rest]))
