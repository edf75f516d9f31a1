"""Rule families: whether a path is invalid that comes closer to an item than the user's margin.

Every family uses the margins of conf/users/ and permits some of the paths that violate them. A path that keeps
every margin is valid in every family.
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.world.bezier import P_F, P_INIT, curve
from pipeline.world.layout import SYMBOLS, Layouts, point_segment_distance, segment_distance
from pipeline.world.rules import SAMPLES, Margins, valid

Paths = Float[Array, "scene path 2"]
Rule = Callable[[Layouts, Paths, Margins, float], Bool[Array, "scene path"]]  # the last argument comes from conf/


def margin(layouts: Layouts, z_theta: Paths, margins: Margins, reduction_m: float) -> Bool[Array, "scene path"]:
    """Return whether each path keeps the user's margins, each reduced by `reduction_m` [m]."""
    return valid(layouts, z_theta, {s: None if m is None else m - reduction_m for s, m in margins.items()})


def dwell(layouts: Layouts, z_theta: Paths, margins: Margins, share: float) -> Bool[Array, "scene path"]:
    """Return whether each path is within a margin for at most this share of its length."""
    inside = np.zeros((*z_theta.shape[:2], SAMPLES), bool)
    for _, scenes, slack in _slack_by_slot(layouts, z_theta, margins):
        inside[scenes] |= slack < 0
    return inside.mean(-1) <= share


def side(layouts: Layouts, z_theta: Paths, margins: Margins, aside_m: float) -> Bool[Array, "scene path"]:
    """Return whether each path keeps the margins of the items it passes on its right.

    An item is on the right if its centre is at least `aside_m` [m] to the right of the path's tangent at the nearest
    point.
    """
    t, z, points = np.linspace(0.0, 1.0, SAMPLES)[:, None], z_theta[:, :, None], curve(z_theta, SAMPLES)
    tangent = (1 - t) * (z - P_INIT) + t * (P_F - z)  # (scene, path, point, 2)
    tangent = tangent / np.maximum(np.linalg.norm(tangent, axis=-1, keepdims=True), 1e-12)
    broken = np.zeros(z_theta.shape[:2], bool)
    for slot, scenes, slack in _slack_by_slot(layouts, z_theta, margins):
        closest = slack.argmin(-1)[..., None, None]
        direction, point = (np.take_along_axis(x[scenes], closest, 2)[:, :, 0] for x in (tangent, points))
        to_item = layouts.centre[scenes, slot][:, None] - point
        right_m = direction[..., 1] * to_item[..., 0] - direction[..., 0] * to_item[..., 1]
        broken[scenes] |= (slack.min(-1) < 0) & (right_m >= aside_m)
    return ~broken


def proximity(layouts: Layouts, z_theta: Paths, margins: Margins, within_m: float) -> Bool[Array, "scene path"]:
    """Return whether each path keeps the margins of items that have a neighbour.

    A neighbour is any other item whose footprint is at most `within_m` [m] away.
    """
    gap = segment_distance(layouts.ends[:, :, None], layouts.ends[:, None])  # (scene, slot, slot)
    gap = gap - layouts.radius[:, :, None] - layouts.radius[:, None]
    other = layouts.present[:, :, None] & layouts.present[:, None] & ~np.eye(gap.shape[1], dtype=bool)
    has_neighbour = np.any(other & (gap <= within_m), axis=-1)  # (scene, slot)
    broken = np.zeros(z_theta.shape[:2], bool)
    for slot, scenes, slack in _slack_by_slot(layouts, z_theta, margins):
        broken[scenes] |= has_neighbour[scenes, slot, None] & (slack.min(-1) < 0)
    return ~broken


OWN_FAMILY = "margin"  # family of conf/users/, with which the others are compared
FAMILIES: dict[str, Rule] = {f.__name__: f for f in (margin, dwell, side, proximity)}


def _slack_by_slot(
    layouts: Layouts, z_theta: Paths, margins: Margins
) -> Iterator[tuple[int, Int[Array, " chosen"], Float[Array, "chosen path point"]]]:
    """Yield each slot, the scenes in which its item has a margin, and each path point's slack [m] there."""
    by_symbol = np.array([np.nan if margins[s] is None else margins[s] for s in SYMBOLS] + [np.nan])
    for slot in range(layouts.symbol.shape[1]):
        margin_m = by_symbol[layouts.symbol[:, slot]]
        scenes = np.flatnonzero(~np.isnan(margin_m))
        a, b = (layouts.ends[scenes, slot, end][:, None, None] for end in (0, 1))
        reach = (layouts.radius[scenes, slot] + margin_m[scenes])[:, None, None]
        yield slot, scenes, point_segment_distance(curve(z_theta[scenes], SAMPLES), a, b) - reach
