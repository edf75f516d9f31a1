"""Draw kitchenware at random: bowls, plates, cutlery and glasses as meshes with their materials.

Each symbol has shapes and finishes that are `taught`, others that are `held_out` and others that are `sealed`. A design
of kinds `held_out` or `sealed` has a shape and a finish of which no other kind of split holds any.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from making.render import finishes
from making.render.meshes import Mesh, into_capsule, outline_gap, rounded, swept, turned

MAX_GAP_M = 0.0005  # largest distance between a mesh's outline from above and its footprint
MAX_TRIES = 10  # draws of a design until its outline fits

Rng = np.random.Generator
Paint = Callable[[str], Any]  # name -> Blender's material


class Part(NamedTuple):
    """Hold one mesh of an item and the function that makes its material."""

    mesh: Mesh
    paint: Paint


class Design(NamedTuple):
    """Hold an item: what it is, its footprint [m] and its parts."""

    symbol: str
    shape: str
    finish: str
    radius: float
    half_length: float
    parts: list[Part]


KINDS = ("taught", "held_out", "sealed")  # a column each of the tables of shapes and finishes
SHAPES = {
    "bowl": (("hemisphere", "footed", "straight"), ("oval", "lipped", "stepped", "flared", "incurved", "boat"),
             ("bell", "trough")),
    "plate": (("rimmed", "coupe"), ("platter", "tray", "saucer", "pasta plate", "cake stand"), ("terraced", "board")),
    "cutlery": (("fork", "knife", "spoon"),
                ("spatula", "chopsticks", "dessert fork", "ladle", "tongs", "cake server"), ("butter knife", "paddle")),
    "glass": (("tumbler", "tapered", "stemless"), ("oval tumbler", "goblet", "heavy", "waisted", "coupe glass"),
              ("martini", "pedestal")),
}  # fmt: skip
CROCKERY = (
    ("glazed", "ringed", "speckled"),
    ("sectors", "wood", "metal", "two glazes", "crackled", "dotted", "gilded"),
    ("dipped", "chequered", "marbled"),
)
FINISHES = {
    "bowl": CROCKERY,
    "plate": CROCKERY,
    "cutlery": (("steel", "plastic handle"), ("brass", "wood", "plastic", "black steel", "striped handle"),
                ("rainbow steel", "swirled handle")),
    "glass": (("clear", "pale tint"), ("deep tint", "frosted", "coloured rim", "smoked", "ribbed"),
              ("bubbled", "graded")),
}  # fmt: skip


def design(rng: Rng, symbol: str, kinds: str) -> Design:
    """Draw an item of `symbol` whose shape and finish are `kinds`: taught, held_out or sealed.

    Its outline from above is its footprint within MAX_GAP_M. A draw that misses it, as chopsticks may, is drawn again.
    """
    for _ in range(MAX_TRIES):
        shape, finish = (str(rng.choice(table[symbol][KINDS.index(kinds)])) for table in (SHAPES, FINISHES))
        made = {"bowl": _bowl, "plate": _plate, "cutlery": _cutlery, "glass": _glass}[symbol](rng, shape, finish)
        meshes = [part.mesh for part in made.parts]
        gap = outline_gap(meshes, made.radius, made.half_length, filled=symbol != "cutlery")
        if gap <= MAX_GAP_M:
            return made
    raise ValueError(f"{shape}: outline and footprint differ by {1000 * gap:.2f} mm in {MAX_TRIES} draws")


def _wall(outer: list[tuple[float, float]], thickness: float, floor: float, foot: float = 0.0) -> np.ndarray:
    """Return the closed profile of a vessel from its outer wall: a round rim, then the same wall further in.

    The inside reaches down to the height `floor` [m]; what lies below `foot` [m], such as a stem, is solid.
    """
    wall = rounded(np.array(outer))
    inner = wall[wall[:, 1] >= foot] - [thickness, 0.0]
    inner[:, 1] = np.maximum(inner[:, 1], floor)
    inner = inner[inner[:, 0] > 0.15 * wall[:, 0].max()]
    rim = np.array([[wall[-1, 0] - thickness / 2, wall[-1, 1] + thickness / 2]])
    inside = np.concatenate([inner[::-1], [[0.0, floor]]])
    return rounded(np.concatenate([[[0.0, wall[0, 1]]], wall, rim, inside]), 1)


def _bowl(rng: Rng, shape: str, finish: str) -> Design:
    """Draw a bowl: depth about two thirds of its radius, a wall of 3 to 7 mm."""
    radius, half_length = rng.uniform(0.058, 0.077), 0.0
    high, foot = radius * rng.uniform(0.55, 0.9), radius * rng.uniform(0.38, 0.6)
    raised = rng.uniform(0.004, 0.009) if shape == "footed" else rng.uniform(0.0005, 0.002)
    wall = rng.uniform(0.0035, 0.0065)
    if shape in ("oval", "boat"):
        half_length = radius * rng.uniform(0.15, 0.5)
    if shape == "trough":
        half_length, high = radius * rng.uniform(0.6, 0.9), 0.7 * high
    radius = radius / (1 + 0.6 * half_length / radius)
    bulge = {"straight": 1.1, "lipped": 1.7, "flared": 0.7, "boat": 0.8, "trough": 3.5}.get(shape, 2.2)
    steps, bulge = np.linspace(0, 1, 7), bulge * rng.uniform(0.85, 1.2)
    if shape == "stepped":
        steps, bulge = np.array([0, 0.5, 0.55, 0.56, 1.0]), 1.3
    outer = [(foot, 0.0), (foot, raised)]
    outer += [(foot + (radius - foot) * s ** (1 / bulge), raised + (high - raised) * s) for s in steps[1:]]
    if shape == "lipped":
        lip = radius * rng.uniform(0.12, 0.22)
        outer = [(r * (radius - lip) / radius, z) for r, z in outer] + [(radius, high + 0.002)]
    if shape == "incurved":
        mouth = radius * rng.uniform(0.74, 0.88)
        belly = [(0.86, 0.25), (0.97, 0.45), (1.0, 0.6), (0.97, 0.78)]
        outer = [(foot, 0.0), *((share * radius, height * high) for share, height in belly), (mouth, high)]
    if shape == "bell":
        sides = [(0.62, 0.08), (0.74, 0.25), (0.78, 0.55), (0.84, 0.8), (1.0, 1.0)]
        outer = [(0.5 * radius, 0.0), *((share * radius, height * high) for share, height in sides)]
    mesh = turned(_wall(outer, wall, raised + wall), radius, half_length)
    return Design("bowl", shape, finish, radius, half_length, [Part(mesh, _crockery(rng, finish))])


def _plate(rng: Rng, shape: str, finish: str) -> Design:
    """Draw a plate: 1 to 3 cm high, with a well and a rim unless it is a coupe."""
    radius, half_length = rng.uniform(0.066, 0.085), 0.0
    if shape in ("platter", "board"):
        half_length = radius * rng.uniform(0.2, 0.6)
        radius = radius / (1 + 0.6 * half_length / radius)
    high, thick = rng.uniform(0.010, 0.022), rng.uniform(0.003, 0.005)
    foot, well = radius * rng.uniform(0.45, 0.6), radius * rng.uniform(0.62, 0.76)
    lift = high * rng.uniform(0.35, 0.7)
    outer = {
        "rimmed": [(well, lift), (well * 1.04, lift * 1.2), (radius, high)],
        "platter": [(well, lift), (well * 1.04, lift * 1.2), (radius, high)],
        "coupe": [(0.75 * radius, 0.3 * high), (0.92 * radius, 0.6 * high), (radius, high)],
        "tray": [(0.97 * radius, 0.002), (0.98 * radius, 0.003), (0.985 * radius, 0.9 * high), (radius, high)],
        "pasta plate": [(0.6 * radius, 0.7 * high + 0.006), (0.64 * radius, high + 0.006), (radius, high + 0.01)],
        "cake stand": [(foot, 0.003), (0.15 * radius, 0.01), (0.15 * radius, high + 0.015), (radius, high + 0.02)],
        "terraced": [(0.4 * radius, 0.004), (0.44 * radius, high), (0.7 * radius, high), (0.73 * radius, 1.7 * high)],
        "board": [(0.97 * radius, 0.001), (radius, 0.004), (radius, high)],
        "saucer": [(0.3 * radius + 0.5 * foot, 0.004), (well, 0.006), (0.9 * radius, high), (radius, high * 0.95)],
    }[shape]
    below = np.array([(0.0, 0.001), (foot, 0.0), *outer])
    above = below[::-1] + np.array([0.0, thick])
    above[0, 0] -= thick / 2
    if shape == "board":
        above = np.array([(0.97 * radius, high + 0.002), (0.0, high + 0.002)])
    if shape == "cake stand":
        top, lip = high + 0.02 + thick, rng.uniform(0.002, 0.006)
        edge = radius - 0.004
        above = np.array([(radius, top + lip), (edge, top + lip), (edge - 0.003, top), (0.0, top)])
    if shape == "saucer":
        ring = rng.uniform(0.2, 0.3) * radius
        extra = [(ring * 1.25, thick + 0.001), (ring * 1.12, thick + 0.004), (ring, thick + 0.001)]
        above = np.concatenate([above[:-1], extra, above[-1:]])
    mesh = turned(rounded(np.concatenate([below, above]), 2), radius, half_length)
    return Design("plate", shape, finish, radius, half_length, [Part(mesh, _crockery(rng, finish))])


def _crockery(rng: Rng, finish: str) -> Paint:
    """Return the material of a bowl or plate."""
    seed = int(rng.integers(2**31))
    if finish == "wood":
        return partial(finishes.wood, seed)
    if finish == "metal":
        return partial(finishes.metal, seed, "enamel")
    return partial(finishes.ceramic, seed, finish)


def _glass(rng: Rng, shape: str, finish: str) -> Design:
    """Draw a glass: 6 to 14 cm high, with a thick base and a wall of 1.5 to 5 mm."""
    radius, half_length = rng.uniform(0.037, 0.049), 0.0
    high, base, wall = rng.uniform(0.07, 0.125), rng.uniform(0.005, 0.013), rng.uniform(0.0015, 0.0028)
    foot, start = radius * rng.uniform(0.82, 0.97), 0.0
    if shape == "tapered":
        foot = radius * rng.uniform(0.6, 0.78)
    if shape == "heavy":
        high, base, wall = rng.uniform(0.06, 0.085), rng.uniform(0.014, 0.022), rng.uniform(0.004, 0.006)
    if shape == "oval tumbler":
        half_length = radius * rng.uniform(0.2, 0.45)
        radius = radius / (1 + 0.6 * half_length / radius)
        foot = min(foot, 0.95 * radius)
    if shape == "waisted":
        waist = radius * rng.uniform(0.68, 0.8)
        outer = [(foot, 0.0), (foot, 0.004), (waist, 0.4 * high), (0.97 * waist, 0.55 * high), (radius, high)]
    elif shape in ("coupe glass", "martini"):
        start, foot = rng.uniform(0.05, 0.075), radius * rng.uniform(0.6, 0.75)
        cup = [(0.2, 0.0), (1.0, 1.0)] if shape == "martini" else [(0.35, 0.0), (0.75, 0.25), (0.95, 0.6), (1.0, 1.0)]
        stem = [(foot, 0.0), (foot, 0.002), (0.006, 0.006), (0.005, start - 0.006)]
        outer, base = stem + [(r * radius, start + z * 0.4 * high) for r, z in cup], min(base, 0.006) + start
    elif shape == "pedestal":
        start = rng.uniform(0.012, 0.022)
        outer = [(foot, 0.0), (foot, 0.003), (0.45 * foot, 0.5 * start), (0.8 * radius, 1.4 * start), (radius, high)]
        base += start
    elif shape in ("stemless", "goblet"):
        mouth, waist = radius * rng.uniform(0.66, 0.8), rng.uniform(0.35, 0.5)
        cup = [(0.5, 0.0), (0.86, 0.12), (0.98, 0.28), (1.0, waist), (0.93, 0.72), (mouth / radius, 1.0)]
        stem = []
        if shape == "goblet":
            start, foot = rng.uniform(0.035, 0.06), 0.8 * radius
            stem = [(foot, 0.0), (foot, 0.002), (0.006, 0.006), (0.005, start - 0.008)]
        outer, base = stem + [(r * radius, start + z * high) for r, z in cup], base + start
    else:
        outer = [(foot, 0.0), (foot * 1.01, 0.003), ((foot + radius) / 2, high / 2), (radius, high)]
    mesh = turned(_wall(outer, wall, base, start), radius, half_length)
    paint = partial(finishes.glass, int(rng.integers(2**31)), finish)
    return Design("glass", shape, finish, radius, half_length, [Part(mesh, paint)])


def _cutlery(rng: Rng, shape: str, finish: str) -> Design:
    """Draw a piece of cutlery, lying flat with an arched handle: 16 to 21 cm long, 18 to 30 mm wide."""
    radius, length = rng.uniform(0.0095, 0.014), rng.uniform(0.16, 0.205)
    if shape in ("knife", "chopsticks"):
        radius = rng.uniform(0.009, 0.011)
    if shape == "dessert fork":
        length = rng.uniform(0.135, 0.16)
    half_length = length / 2 - radius
    seed = int(rng.integers(2**31))
    metal: Paint = partial(finishes.metal, seed, finish if finish == "brass" or "steel" in finish else "steel")
    makers = {pattern: partial(finishes.two_colours, pattern) for pattern in ("striped", "swirled")}
    makers |= {"plastic": finishes.plastic, "wood": finishes.wood}
    maker = makers.get(finish.removesuffix(" handle"))
    handle: Paint = partial(maker, seed) if maker else metal
    head = metal if finish.endswith(" handle") else handle
    parts = [
        Part(into_capsule(mesh, radius, half_length), head if is_head else handle)
        for mesh, is_head in _piece(rng, shape, radius, length / 2)
    ]
    return Design("cutlery", shape, finish, radius, half_length, parts)


def _piece(rng: Rng, shape: str, radius: float, reach: float) -> list[tuple[Mesh, bool]]:
    """Return the meshes of a piece from x = -reach (handle) to reach (head), each with whether it is the head."""
    if shape == "chopsticks":
        x = np.linspace(-reach, reach, 24)
        width = np.interp(x, [-reach, reach], [0.0038, 0.0022])
        apart = (radius - 0.0038) * np.linspace(1.0, rng.uniform(0.0, 0.6), len(x))
        return [(_rod(x, side * apart, width, width, 0.001), False) for side in (-1, 1)]
    if shape == "tongs":
        x = np.linspace(-reach, reach, 36)
        width = np.interp(x, [-reach, -0.8 * reach, 0.7 * reach, reach], [0.0022, 0.0028, 0.0030, 0.0045])
        apart = (radius - 0.003) * np.interp(x, [-reach, -0.9 * reach, 0.4 * reach, reach], [0.1, 0.5, 1.0, 0.55])
        return [(_rod(x, side * apart, width, np.full_like(x, 0.0015), 0.001), True) for side in (-1, 1)]
    neck = reach * rng.uniform(0.18, 0.34)  # x at which the head begins
    x = np.linspace(-reach, neck + 0.003, 36)
    butt, slim = radius * rng.uniform(0.6, 0.95), radius * rng.uniform(0.22, 0.4)
    if shape in ("knife", "spatula"):
        slim = butt * rng.uniform(0.6, 0.95)
    width = np.interp(x, [-reach, -0.75 * reach, 0, neck], [0.75 * butt, butt, slim * 1.2, slim])
    handle = _rod(x, 0 * x, width, np.full_like(x, rng.uniform(0.0012, 0.003)), 0.001, arch=rng.uniform(0.002, 0.007))
    x = np.linspace(neck - 0.004, reach, 36)
    share = (x - x[0]) / np.ptp(x)
    thin = np.full_like(x, rng.uniform(0.0007, 0.0011))
    blades = {  # place along the head, and half-width there [radius]; it begins as wide as the handle
        "knife": ([0, 0.1, 0.6, 0.85, 1], [0.9, 1, 0.8, 0.25]),
        "spatula": ([0, 0.25, 0.9, 1], [0.8, 1, 0.9]),
        "butter knife": ([0, 0.12, 0.5, 0.8, 1], [0.7, 1, 0.95, 0.5]),
        "paddle": ([0, 0.25, 0.5, 0.85, 1], [0.9, 1, 1, 0.7]),
        "cake server": ([0, 0.08, 0.15, 1], [0.5, 1, 0.15]),
    }
    if shape in blades:
        places, widths = blades[shape]
        width = radius * np.interp(share, places, [slim / radius, *widths])
        return [(handle, False), (_rod(x, 0 * x, width, thin, 0.001), True)]
    if shape == "ladle":
        round_ = np.sqrt(np.clip(1 - ((x - (reach - radius)) / radius) ** 2, 0, 1))
        width = np.maximum(radius * round_, slim * (x < reach - radius))
        return [(handle, False), (_rod(x, 0 * x, width, thin, 0.0012, cup=0.009 * round_), True)]
    if shape == "spoon":
        oval = np.sqrt(np.clip(1 - ((share - 0.58) / 0.42) ** 2, 0, 1))
        width = np.maximum(radius * oval, slim * (share < 0.3))
        return [(handle, False), (_rod(x, 0 * x, width, thin, 0.0012, cup=0.006 * oval), True)]
    tines = 3 if shape == "dessert fork" else 4
    root = rng.uniform(0.35, 0.5)
    palm = share <= root + 0.04
    width = radius * np.interp(share, [0, 0.2, root], [slim / radius, 0.85, 1.0])
    meshes = [(handle, False), (_rod(x[palm], 0 * x[palm], width[palm], thin[palm], 0.002), True)]
    each = radius / tines * rng.uniform(0.55, 0.7)
    x, share, thin = (values[share >= root] for values in (x, share, thin))
    taper = each * np.interp(share, [root, 0.9, 1.0], [1, 0.75, 0.4])
    middles = np.linspace(-radius + each, radius - each, tines)
    return meshes + [(_rod(x, np.full_like(x, middle), taper, thin, 0.002), True) for middle in middles]


def _rod(x, y, width, thickness, lift: float, arch: float = 0.0, cup: np.ndarray | float = 0.0) -> Mesh:
    """Return a swept rod that lies on the table, raised by `lift` [m] and by `arch` in its middle, with closed ends."""
    z = lift + thickness + arch * np.sin(np.pi * (x - x[0]) / np.ptp(x))
    x, y, z, width, thickness = (np.concatenate([v[:1], v, v[-1:]]) for v in (x, y, z, width, thickness))
    cup = np.concatenate([np.broadcast_to(cup, len(x) - 2)[i] for i in (slice(1), slice(None), slice(-1, None))])
    width[[0, -1]] = thickness[[0, -1]] = 1e-5
    return swept(np.stack([x, y, z], -1), width, thickness, cup)
