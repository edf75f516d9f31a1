"""Users whose rules are of another form: what a model that takes a clearance and a margin for granted cannot represent.

Each form keeps the user's margins and forgives some of the paths that break them, never the other way round: a path
that the user finds valid is valid by every form.
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.world.bezier import P_F, P_INIT, curve
from pipeline.world.layout import SYMBOLS, Layouts, point_segment_distance, segment_distance
from pipeline.world.rules import SAMPLES, Margins, valid

Paths = Float[Array, "scene path 2"]
Form = Callable[[Layouts, Paths, Margins, float], Bool[Array, "scene path"]]  # with the amount that conf/ gives it


def margin(layouts: Layouts, z_theta: Paths, margins: Margins, less: float) -> Bool[Array, "scene path"]:
    """The users' own form, every margin narrower by `less` [m]."""
    return valid(layouts, z_theta, {s: None if m is None else m - less for s, m in margins.items()})


def brief(layouts: Layouts, z_theta: Paths, margins: Margins, share: float) -> Bool[Array, "scene path"]:
    """A path may come too near, but for no more than this share of its way."""
    near = np.zeros((*z_theta.shape[:2], SAMPLES), bool)
    for _, scenes, room in _minded(layouts, z_theta, margins):
        near[scenes] |= room < 0
    return near.mean(-1) <= share


def right(layouts: Layouts, z_theta: Paths, margins: Margins, aside: float) -> Bool[Array, "scene path"]:
    """Only what is passed on the path's right is minded: its middle at least `aside` [m] from the nearest tangent."""
    t, z, points = np.linspace(0.0, 1.0, SAMPLES)[:, None], z_theta[:, :, None], curve(z_theta, SAMPLES)
    heading = (1 - t) * (z - P_INIT) + t * (P_F - z)  # (scene, path, point, 2)
    heading = heading / np.maximum(np.linalg.norm(heading, axis=-1, keepdims=True), 1e-12)
    broken = np.zeros(z_theta.shape[:2], bool)
    for slot, scenes, room in _minded(layouts, z_theta, margins):
        nearest = room.argmin(-1)[..., None, None]
        ahead, here = (np.take_along_axis(x[scenes], nearest, 2)[:, :, 0] for x in (heading, points))
        to = layouts.centre[scenes, slot][:, None] - here
        to_the_right = ahead[..., 1] * to[..., 0] - ahead[..., 0] * to[..., 1]
        broken[scenes] |= (room.min(-1) < 0) & (to_the_right >= aside)
    return ~broken


def beside(layouts: Layouts, z_theta: Paths, margins: Margins, within: float) -> Bool[Array, "scene path"]:
    """Only what stands beside something else is minded: a gap [m] of at most `within` between the footprints."""
    gap = segment_distance(layouts.ends[:, :, None], layouts.ends[:, None])  # (scene, slot, slot)
    gap = gap - layouts.radius[:, :, None] - layouts.radius[:, None]
    both = layouts.present[:, :, None] & layouts.present[:, None] & ~np.eye(gap.shape[1], dtype=bool)
    accompanied = np.any(both & (gap <= within), axis=-1)  # (scene, slot)
    broken = np.zeros(z_theta.shape[:2], bool)
    for slot, scenes, room in _minded(layouts, z_theta, margins):
        broken[scenes] |= accompanied[scenes, slot, None] & (room.min(-1) < 0)
    return ~broken


def late(layouts: Layouts, z_theta: Paths, margins: Margins, share: float) -> Bool[Array, "scene path"]:
    """Only what is passed after this share of the way is minded."""
    broken = np.zeros(z_theta.shape[:2], bool)
    for _, scenes, room in _minded(layouts, z_theta, margins):
        passed = room.argmin(-1) / (SAMPLES - 1)
        broken[scenes] |= (room.min(-1) < 0) & (passed > share)
    return ~broken


def several(layouts: Layouts, z_theta: Paths, margins: Margins, count: float) -> Bool[Array, "scene path"]:
    """A path may come too near to things, but to fewer than `count` of them."""
    broken = np.zeros(z_theta.shape[:2], int)
    for _, scenes, room in _minded(layouts, z_theta, margins):
        broken[scenes] += room.min(-1) < 0
    return broken < count


OWN = "margin"  # the form of conf/users.yaml, which the others are held against
FORMS: dict[str, Form] = {f.__name__: f for f in (margin, brief, right, beside, late, several)}


def _minded(
    layouts: Layouts, z_theta: Paths, margins: Margins
) -> Iterator[tuple[int, Int[Array, " minded"], Float[Array, "minded path point"]]]:
    """Each slot: scenes where its item is minded, and how far [m] the points of paths there stay out of its margin."""
    wanted = np.array([np.nan if margins[s] is None else margins[s] for s in SYMBOLS] + [np.nan])
    for slot in range(layouts.symbol.shape[1]):
        margin = wanted[layouts.symbol[:, slot]]
        scenes = np.flatnonzero(~np.isnan(margin))
        a, b = (layouts.ends[scenes, slot, end][:, None, None] for end in (0, 1))
        keep = (layouts.radius[scenes, slot] + margin[scenes])[:, None, None]
        yield slot, scenes, point_segment_distance(curve(z_theta[scenes], SAMPLES), a, b) - keep
