"""Rules of other families than fixed margins, written without the clearance model whose families they check.

Every rule uses a user's margins and permits some of the paths that violate them.
"""

from collections.abc import Callable, Iterator

import numpy as np

from pipeline.world.bezier import P_F, P_INIT, curve
from pipeline.world.layout import SYMBOLS, Layouts, point_segment_distance
from pipeline.world.rules import SAMPLES, Margins, valid
from studies.shift.stage import proximity


def margin(layouts: Layouts, z_theta: np.ndarray, margins: Margins, reduction_m: float) -> np.ndarray:
    """Whether each path keeps the user's margins, each reduced by `reduction_m` [m]."""
    return valid(layouts, z_theta, {s: None if m is None else m - reduction_m for s, m in margins.items()})


def dwell(layouts: Layouts, z_theta: np.ndarray, margins: Margins, share: float) -> np.ndarray:
    """Whether each path is within a margin for at most this share of its length."""
    inside = np.zeros((*z_theta.shape[:2], SAMPLES), bool)
    for _, slack in slack_by_slot(layouts, z_theta, margins):
        inside |= slack < 0
    return inside.mean(-1) <= share


def side(layouts: Layouts, z_theta: np.ndarray, margins: Margins, aside_m: float) -> np.ndarray:
    """Whether each path keeps the margins of items whose centre is at least `aside_m` [m] to its right."""
    t, z, points = np.linspace(0.0, 1.0, SAMPLES)[:, None], z_theta[:, :, None], curve(z_theta, SAMPLES)
    tangent = (1 - t) * (z - P_INIT) + t * (P_F - z)  # (scene, path, point, 2)
    tangent = tangent / np.maximum(np.linalg.norm(tangent, axis=-1, keepdims=True), 1e-12)
    broken = np.zeros(z_theta.shape[:2], bool)
    for slot, slack in slack_by_slot(layouts, z_theta, margins):
        closest = slack.argmin(-1)[..., None, None]
        direction, point = (np.take_along_axis(x, closest, 2)[:, :, 0] for x in (tangent, points))
        to_item = layouts.centre[:, slot][:, None] - point
        right_m = direction[..., 1] * to_item[..., 0] - direction[..., 0] * to_item[..., 1]
        broken |= (slack.min(-1) < 0) & (right_m >= aside_m)
    return ~broken


FAMILIES: dict[str, Callable[..., np.ndarray]] = {f.__name__: f for f in (margin, dwell, side, proximity)}


def slack_by_slot(layouts: Layouts, z_theta: np.ndarray, margins: Margins) -> Iterator[tuple[int, np.ndarray]]:
    """Yield each slot and the slack [m] of each point of each path there; inf without a margin."""
    by_symbol = np.array([-np.inf if margins[s] is None else margins[s] for s in SYMBOLS] + [-np.inf])
    for slot in range(layouts.symbol.shape[1]):
        a, b = (layouts.ends[:, slot, end][:, None, None] for end in (0, 1))
        reach = (layouts.radius[:, slot] + by_symbol[layouts.symbol[:, slot]])[:, None, None]
        yield slot, point_segment_distance(curve(z_theta, SAMPLES), a, b) - reach
