"""Place items on the 1 m table at random, as capsule footprints; the kinds of item are those of symbols.yaml.

A capsule holds all points within `radius` of a segment of half-length `half_length`. A round item has half-length 0;
cutlery is a long, thin capsule.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import numpy as np
import yaml
from jaxtyping import Bool, Float, Int
from numpy import ndarray as Array
from pydantic import Field, TypeAdapter, ValidationError

from pipeline.runtime.errors import InputError
from pipeline.runtime.settings import Chance, Count, Distance, Group, Size, Whole
from pipeline.world.bezier import P_F, P_INIT

SIDE = 100  # pixels per side of a table image, and so per metre
EMPTY = -1  # symbol index of an empty slot
MAX_TRIES = 1000  # random draws of a scene, or of an added item's position, before giving up


class Symbol(Group):
    """The appearance of one kind of item; the defaults suit an opaque, flat object."""

    concavity: Chance = 0.0  # gain in brightness of a hollow item on the side away from the lamp
    shadow: Chance = 0.34  # share of the lamp's light that its shadow blocks
    height_m: Chance = 0.009  # height that shifts its shadow away from the lamp [m]
    transparent: bool = False  # the table shows through, but the rim casts the shadow of a solid item


_FILE = Path(__file__).with_name("symbols.yaml")
try:
    _KINDS = TypeAdapter(dict[str, Symbol]).validate_python(yaml.safe_load(_FILE.read_text(encoding="utf-8")))
except (yaml.YAMLError, ValidationError) as error:
    raise InputError(f"{_FILE}: {' '.join(str(error).split())}") from error
SYMBOLS, APPEARANCES = tuple(_KINDS), tuple(_KINDS.values())  # layouts store a symbol as its position


@dataclass(frozen=True)
class Layouts:
    """A batch of scenes, padded to the same number of slots; empty slots have `symbol == EMPTY`.

    `item` is the row in items.csv and `symbol` the index into SYMBOLS. Lengths are in metres; angles are in radians
    from the table's x axis.
    """

    item: Int[Array, "scene slot"]  # row of items.csv; EMPTY without an item
    symbol: Int[Array, "scene slot"]  # index into SYMBOLS; EMPTY without an item
    centre: Float[Array, "scene slot 2"]  # of the footprint [m]
    angle: Float[Array, "scene slot"]  # of the footprint's long axis [rad]
    scale: Float[Array, "scene slot"]  # size relative to the catalogue entry
    half_length: Float[Array, "scene slot"]  # of the footprint's segment [m]
    radius: Float[Array, "scene slot"]  # of the footprint's capsule [m]

    def __len__(self) -> int:
        return len(self.symbol)

    def __getitem__(self, scenes) -> "Layouts":
        """Return the selected scenes (a slice, an index array or a mask)."""
        return Layouts(*(getattr(self, f.name)[scenes] for f in fields(self)))

    @property
    def present(self) -> Bool[Array, "scene slot"]:
        """Return True for each slot that holds an item."""
        return self.symbol != EMPTY

    @property
    def ends(self) -> Float[Array, "scene slot 2 2"]:
        """Return both end points [m] of each footprint's segment."""
        along = np.stack([np.cos(self.angle), np.sin(self.angle)], axis=-1) * self.half_length[..., None]
        return np.stack([self.centre - along, self.centre + along], axis=-2)


def point_segment_distance(
    p: Float[Array, "*#b 2"], a: Float[Array, "*#b 2"], b: Float[Array, "*#b 2"]
) -> Float[Array, "*b_all"]:
    """Return the distance [m] from each point `p` to the segment from `a` to `b` (broadcasting)."""
    # One coordinate at a time: numpy reduces an axis of length 2 several times slower than it adds two arrays.
    ab_x, ab_y = b[..., 0] - a[..., 0], b[..., 1] - a[..., 1]
    ap_x, ap_y = p[..., 0] - a[..., 0], p[..., 1] - a[..., 1]
    t = np.clip((ap_x * ab_x + ap_y * ab_y) / np.maximum(ab_x**2 + ab_y**2, 1e-18), 0.0, 1.0)
    return np.asarray(np.sqrt((ap_x - t * ab_x) ** 2 + (ap_y - t * ab_y) ** 2))


def segment_distance(a: Float[Array, "*#s 2 2"], b: Float[Array, "*#s 2 2"]) -> Float[Array, "*s_all"]:
    """Return the distance [m] between segments given by their end points (broadcasting); 0 where they cross."""
    a, b = np.broadcast_arrays(a, b)
    a0, a1, b0, b1 = a[..., 0, :], a[..., 1, :], b[..., 0, :], b[..., 1, :]
    from_ends = [point_segment_distance(*x) for x in ((a0, b0, b1), (a1, b0, b1), (b0, a0, a1), (b1, a0, a1))]

    def side(p: Array, q: Array, r: Array) -> Array:
        u, v = q - p, r - p
        return np.asarray(u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0])

    cross = (side(a0, a1, b0) * side(a0, a1, b1) < 0) & (side(b0, b1, a0) * side(b0, b1, a1) < 0)
    return np.where(cross, 0.0, np.min(from_ends, axis=0))


@dataclass(frozen=True)
class Items:
    """The catalogue columns that layouts need, one entry per item; lengths [m] at scale 1."""

    symbol: Int[Array, " item"]
    half_length: Float[Array, " item"]
    radius: Float[Array, " item"]


class LayoutRules(Group):
    """Rules for drawing scenes (conf/scenes.yaml): numbers of items, probabilities and minimum distances."""

    items_per_scene: Annotated[tuple[Whole, ...], Field(strict=False)]  # numbers of items, drawn uniformly
    glasses_chance: Annotated[tuple[Chance, ...], Field(strict=False)]  # probability of 0, 1, 2, ... glasses in a scene
    centre_low: Chance  # item centres are uniform on [centre_low, centre_high]^2 [m]
    centre_high: Chance
    clear_of_ends: Distance  # minimum distance from a footprint to P_INIT and P_F [m]
    clear_of_items: Distance  # minimum distance between two footprints [m]
    scale_low: Size  # item size relative to its catalogue entry
    scale_high: Size
    slots: Count = 4


def empty(scenes: int, slots: int) -> Layouts:
    """Return scenes without any item."""
    index = np.full((scenes, slots), EMPTY)
    zero = np.zeros((scenes, slots))
    return Layouts(index, index.copy(), np.zeros((scenes, slots, 2)), *(zero.copy() for _ in range(4)))


def concatenated(parts: Sequence[Layouts]) -> Layouts:
    """Return the scenes of all parts one after another, padded to the largest number of slots."""
    together, start = empty(sum(map(len, parts)), max((part.symbol.shape[1] for part in parts), default=0)), 0
    for part in parts:
        for field in fields(part):
            getattr(together, field.name)[start : start + len(part), : part.symbol.shape[1]] = getattr(part, field.name)
        start += len(part)
    return together


def random_layouts(
    rng: np.random.Generator, scenes: int, items: Items, pool: Int[Array, " pool"], rules: LayoutRules
) -> Layouts:
    """Draw scenes with items of `pool` (catalogue rows): first the number of glasses, then other symbols uniformly.

    Raises InputError if no draw out of MAX_TRIES gives every item a free position.
    """
    drawn, glass = [empty(0, rules.slots)], SYMBOLS.index("glass")
    for _ in range(scenes):
        for _ in range(MAX_TRIES):
            scene = empty(1, rules.slots)
            count = int(rng.choice(rules.items_per_scene))
            glasses = min(count, int(rng.choice(len(rules.glasses_chance), p=rules.glasses_chance)))
            others = rng.choice([i for i in range(len(SYMBOLS)) if i != glass], count - glasses)
            symbols = np.concatenate([np.full(glasses, glass), others]).astype(int)
            if all(_place(rng, scene, slot, int(s), items, pool, rules) for slot, s in enumerate(symbols)):
                drawn.append(scene)
                break
        else:
            found = f"no room for {' or '.join(map(str, rules.items_per_scene))} items in {MAX_TRIES} tries"
            fewer = "lower scenes.layout.clear_of_ends or clear_of_items, or ask for fewer items"
            raise InputError(f"{found}: {fewer}")
    return concatenated(drawn)


def add_item(
    rng: np.random.Generator, layouts: Layouts, symbol: int, items: Items, pool: Int[Array, " pool"], rules: LayoutRules
) -> Layouts:
    """Add one random item of `symbol` to each scene under the same minimum distances; return the new scenes.

    Raises InputError if a scene has no free slot, or no free position in MAX_TRIES draws.
    """
    added = [layouts[[scene]] for scene in range(len(layouts))]
    for i, scene in enumerate(added):
        if scene.present.all():
            raise InputError(f"scene {i} has no free slot for a {SYMBOLS[symbol]}: raise scenes.layout.slots")
        if not _place(rng, scene, int(scene.present.argmin()), symbol, items, pool, rules, tries=MAX_TRIES):
            raise InputError(f"no free place for a {SYMBOLS[symbol]} in scene {i}: the scene is too full")
    return concatenated([layouts[:0], *added])


def _place(rng, scene: Layouts, slot: int, symbol, items, pool, rules: LayoutRules, tries: int = 50) -> bool:
    """Place a random item of `symbol` in a slot of one scene by the rules; return False on failure."""
    choices = pool[items.symbol[pool] == symbol]
    if len(choices) == 0:
        raise InputError(f"no {SYMBOLS[symbol]} among the items to draw from: add one to the catalogue")
    item = int(rng.choice(choices))
    scale = rng.uniform(rules.scale_low, rules.scale_high)
    for _ in range(tries):
        centre, angle = rng.uniform(rules.centre_low, rules.centre_high, 2), rng.uniform(-np.pi, np.pi)
        values = (item, symbol, centre, angle, scale, items.half_length[item] * scale, items.radius[item] * scale)
        for field, value in zip(fields(scene), values, strict=True):
            getattr(scene, field.name)[0, slot] = value
        if allowed(scene, np.array([slot]), rules)[0]:
            return True
    return False


def allowed(layouts: Layouts, slot: Int[Array, " scene"], rules: LayoutRules) -> Bool[Array, " scene"]:
    """Return whether the item in `slot` keeps the rules for drawing scenes: in range, clear of items and path ends."""
    index = np.arange(len(slot)), slot
    segment, radius, centre = layouts.ends[index], layouts.radius[index], layouts.centre[index]
    others = layouts.present.copy()
    others[index] = False
    gaps = segment_distance(segment[:, None], layouts.ends) - layouts.radius - radius[:, None]
    from_ends = [point_segment_distance(p, segment[:, 0], segment[:, 1]) - radius for p in (P_INIT, P_F)]
    clear = np.where(others, gaps, np.inf).min(-1) >= rules.clear_of_items
    clear &= np.min(from_ends, axis=0) >= rules.clear_of_ends
    return clear & ((centre >= rules.centre_low) & (centre <= rules.centre_high)).all(-1)
