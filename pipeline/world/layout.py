"""Layouts: items as capsule footprints on a 1 m table, and how a scene is laid out at random.

Every footprint is a capsule: the points within `radius` of a segment of half-length `half_length`.
A round item is a capsule of half-length zero, a piece of cutlery a long thin one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.symbols import SYMBOLS as SYMBOLS  # most modules want both

SIDE = 100  # pixels along an edge of an image of the table, hence per metre
EMPTY = -1  # symbol index of an empty slot
MAX_TRIES = 1000  # draws of a scene's items, or of an added item's place, before an error


@dataclass(frozen=True)
class Layouts:
    """A batch of scenes, padded to the same number of slots; empty slots have `symbol == EMPTY`.

    `item` indexes the catalogue's rows; lengths in metres, angles in radians from the table's x axis.
    """

    item: Int[Array, "scene slot"]
    symbol: Int[Array, "scene slot"]
    centre: Float[Array, "scene slot 2"]
    angle: Float[Array, "scene slot"]
    scale: Float[Array, "scene slot"]
    half_length: Float[Array, "scene slot"]
    radius: Float[Array, "scene slot"]

    def __len__(self) -> int:
        return len(self.symbol)

    def __getitem__(self, scenes) -> "Layouts":
        """Return the chosen scenes (a slice, an index array or a mask)."""
        return Layouts(*(getattr(self, f.name)[scenes] for f in fields(self)))

    @property
    def present(self) -> Bool[Array, "scene slot"]:
        """Return True for each slot that holds an item."""
        return self.symbol != EMPTY

    @property
    def ends(self) -> Float[Array, "scene slot 2 2"]:
        """Return both ends of each footprint's segment [m]."""
        along = np.stack([np.cos(self.angle), np.sin(self.angle)], axis=-1) * self.half_length[..., None]
        return np.stack([self.centre - along, self.centre + along], axis=-2)


def point_segment_distance(
    p: Float[Array, "*#b 2"], a: Float[Array, "*#b 2"], b: Float[Array, "*#b 2"]
) -> Float[Array, "*b_all"]:
    """Return the distance [m] from each point `p` to the segment from `a` to `b` (broadcasting)."""
    # Coordinate by coordinate: numpy reduces an axis of length 2 several times slower than it adds two arrays.
    ab_x, ab_y = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    ap_x, ap_y = p[..., 0] - a[..., 0], p[..., 1] - a[..., 1]
    t = np.clip((ap_x * ab_x + ap_y * ab_y) / np.maximum(ab_x**2 + ab_y**2, 1e-18), 0.0, 1.0)
    return np.asarray(np.sqrt((ap_x - t * ab_x) ** 2 + (ap_y - t * ab_y) ** 2))


def segment_distance(a: Float[Array, "*#s 2 2"], b: Float[Array, "*#s 2 2"]) -> Float[Array, "*s_all"]:
    """Return the distance [m] between segments given by their two ends (broadcasting); 0 where they cross."""
    a, b = np.broadcast_arrays(a, b)
    ends = [
        point_segment_distance(a[..., 0, :], b[..., 0, :], b[..., 1, :]),
        point_segment_distance(a[..., 1, :], b[..., 0, :], b[..., 1, :]),
        point_segment_distance(b[..., 0, :], a[..., 0, :], a[..., 1, :]),
        point_segment_distance(b[..., 1, :], a[..., 0, :], a[..., 1, :]),
    ]
    return np.where(_cross(a, b), 0.0, np.min(ends, axis=0))


def _cross(a: Array, b: Array) -> Array:
    """Return whether two segments properly cross."""

    def side(p: Array, q: Array, r: Array) -> Array:
        u, v = q - p, r - p
        return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])

    a0, a1, b0, b1 = a[..., 0, :], a[..., 1, :], b[..., 0, :], b[..., 1, :]
    return np.asarray((side(a0, a1, b0) * side(a0, a1, b1) < 0) & (side(b0, b1, a0) * side(b0, b1, a1) < 0))


@dataclass(frozen=True)
class Items:
    """The catalogue's columns the layout needs, one entry per item (lengths at scale 1, in metres)."""

    symbol: Int[Array, " item"]
    half_length: Float[Array, " item"]
    radius: Float[Array, " item"]


@dataclass(frozen=True)
class LayoutRules:
    """How scenes are laid out (conf/scenes): counts, chances and clearances."""

    items_per_scene: tuple[int, ...]  # drawn uniformly
    glasses_chance: tuple[float, ...]  # chance of 0, 1, 2, ... glasses in a scene
    centre_low: float  # centres are uniform on [centre_low, centre_high]^2 [m]
    centre_high: float
    clear_of_ends: float  # footprint to P_INIT and P_F [m]
    clear_of_items: float  # footprint to footprint [m]
    scale_low: float  # size of an item relative to its catalogue entry
    scale_high: float
    slots: int = 4

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> "LayoutRules":
        """Read the rules from `scenes.layout` of conf/, whose lists become tuples."""
        lists = ("items_per_scene", "glasses_chance")
        plain: dict[str, Any] = {name: tuple(v) if name in lists else v for name, v in values.items()}
        return cls(**plain)


def empty(scenes: int, slots: int) -> Layouts:
    """Return scenes with nothing on the table."""
    index = np.full((scenes, slots), EMPTY)
    zero = np.zeros((scenes, slots))
    return Layouts(index, index.copy(), np.zeros((scenes, slots, 2)), *(zero.copy() for _ in range(4)))


def random_layouts(
    rng: np.random.Generator, scenes: int, items: Items, pool: Int[Array, " pool"], rules: LayoutRules
) -> Layouts:
    """Draw scenes of items of `pool` (catalogue indices): the number of glasses first, other symbols uniformly.

    Raises InputError if there is no room for a scene's items in MAX_TRIES draws of them.
    """
    layouts = empty(scenes, rules.slots)
    glass = SYMBOLS.index("glass")
    for scene in range(scenes):
        for _ in range(MAX_TRIES):
            count = int(rng.choice(rules.items_per_scene))
            glasses = min(count, int(rng.choice(len(rules.glasses_chance), p=rules.glasses_chance)))
            others = rng.choice([i for i in range(len(SYMBOLS)) if i != glass], count - glasses)
            symbols = np.concatenate([np.full(glasses, glass), others]).astype(int)
            if all(_place(rng, layouts, scene, slot, int(s), items, pool, rules) for slot, s in enumerate(symbols)):
                break
            layouts.symbol[scene] = EMPTY
            layouts.item[scene] = EMPTY
        else:
            raise InputError(
                f"no room for {' or '.join(map(str, rules.items_per_scene))} items in {MAX_TRIES} tries: lower "
                "scenes.layout.clear_of_ends or clear_of_items, or ask for fewer items"
            )
    return layouts


def add_item(
    rng: np.random.Generator,
    layouts: Layouts,
    symbol: int,
    items: Items,
    pool: Int[Array, " pool"],
    rules: LayoutRules,
) -> Layouts:
    """Add one item of `symbol` at random to each scene, under the same clearances; return the new scenes.

    Raises InputError if a scene has no free slot or no free place (MAX_TRIES).
    """
    added = Layouts(*(getattr(layouts, f.name).copy() for f in fields(layouts)))
    for scene in range(len(layouts)):
        free = np.flatnonzero(~layouts.present[scene])
        if len(free) == 0:
            raise InputError(f"scene {scene} has no free slot for a {SYMBOLS[symbol]}: raise scenes.layout.slots")
        if not _place(rng, added, scene, int(free[0]), symbol, items, pool, rules, tries=MAX_TRIES):
            raise InputError(f"no free place for a {SYMBOLS[symbol]} in scene {scene}: the scene is too full")
    return added


def _place(
    rng: np.random.Generator,
    layouts: Layouts,
    scene: int,
    slot: int,
    symbol: int,
    items: Items,
    pool: Int[Array, " pool"],
    rules: LayoutRules,
    tries: int = 50,
) -> bool:
    """Put a random item of `symbol` in `slot` where it is clear of the ends and the items before it."""
    choices = pool[items.symbol[pool] == symbol]
    if len(choices) == 0:
        raise InputError(f"no {SYMBOLS[symbol]} among the items to draw from: add one to the catalogue")
    item = int(rng.choice(choices))
    scale = rng.uniform(rules.scale_low, rules.scale_high)
    radius, half_length = items.radius[item] * scale, items.half_length[item] * scale
    others = layouts.present[scene].copy()
    others[slot] = False
    for _ in range(tries):
        centre = rng.uniform(rules.centre_low, rules.centre_high, 2)
        angle = rng.uniform(-np.pi, np.pi)
        along = np.array([np.cos(angle), np.sin(angle)]) * half_length
        ends = np.stack([centre - along, centre + along])
        if min(point_segment_distance(p, *ends) for p in (P_INIT, P_F)) - radius < rules.clear_of_ends:
            continue
        gaps = segment_distance(ends, layouts.ends[scene, others]) - radius - layouts.radius[scene, others]
        if (gaps < rules.clear_of_items).any():
            continue
        values = (item, symbol, centre, angle, scale, half_length, radius)
        for f, value in zip(fields(layouts), values, strict=True):
            getattr(layouts, f.name)[scene, slot] = value
        return True
    return False
