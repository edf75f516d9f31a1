"""Make table tops as Blender's shader nodes.

Families are `taught`, `held_out` or `sealed`: no table of a sealed family is rendered before the sealed test.
"""

from collections.abc import Callable
from typing import Any

import bpy  # pyright: ignore[reportMissingImports]
import numpy as np

from making.render.finishes import Nodes, Rng, Socket, colour, random_colour


def table_top(rng: Rng, family: str) -> Any:
    """Draw the material of a table top of this family."""
    n = Nodes(bpy.data.materials.new(f"top {family}"))
    draw = next(families[family] for families in FAMILIES.values() if family in families)
    return n.finish(draw(rng, n))


def _two_browns(rng: Rng) -> tuple[tuple, tuple]:
    """Draw a dark and a light tone of one wood."""
    hue, saturation, value = rng.uniform(0.04, 0.105), rng.uniform(0.25, 0.65), rng.uniform(0.4, 0.9)
    return colour(hue, saturation, value * rng.uniform(0.55, 0.85)), colour(hue, saturation * 0.85, value)


def _grain(rng: Rng, n: Nodes, where: Socket) -> Socket:
    """Return the share of light wood: wide figure and fine pores along x."""
    figure = n.noise(n.add("Mapping", {"Vector": where, "Scale": (0.6, rng.uniform(7, 16), 1.0)}), 1.0, 3.0, 0.5)
    rings = n.wave(n.axis(where, 1) + figure * 0.25, rng.uniform(0.03, 0.09))
    pores = n.noise(n.add("Mapping", {"Vector": where, "Scale": (6.0, 160.0, 1.0)}), 1.0)
    strength = rng.uniform(0.2, 0.7)
    return n.step(rings * strength + pores * (1 - strength), 0.2, 0.75)


def _wood(rng: Rng, n: Nodes) -> Socket:
    dark, light = _two_browns(rng)
    grain = _grain(rng, n, n.place(rng))
    return n.principled(
        n.mix(grain, dark, light), Roughness=rng.uniform(0.3, 0.6), Coat_Weight=float(rng.random() < 0.35),
        Coat_Roughness=rng.uniform(0.1, 0.3),
    )  # fmt: skip


def _folds(rng: Rng, n: Nodes, turn: float) -> Socket:
    """Return the height of a cloth: soft wrinkles, and in some the creases in which it was folded."""
    wrinkles = n.noise(n.place(rng), rng.uniform(2, 6), 2.0, 1.0) * rng.uniform(0.0, 1.0)
    if rng.random() < 0.5:
        return wrinkles
    where, period = n.place(rng, turn=turn), rng.uniform(0.22, 0.45)
    along, across = (n.step(n.wave(n.axis(where, i), period), 0.88, 1.0) for i in (0, 1))
    return wrinkles + (along + across) * rng.uniform(0.05, 0.2)


def _cloth_of(rng: Rng, n: Nodes, painted: Socket, turn: float) -> Socket:
    """Return a cloth in these colours: threads, wrinkles, no gloss."""
    where = n.place(rng, turn=turn)
    warp, weft = (n.wave(n.axis(where, i), 0.0025) for i in (0, 1))
    slubs = n.noise(n.place(rng, (1.0, 12.0), turn), 40.0)
    height = _folds(rng, n, turn) + (warp + weft) * 0.01
    faded = n.mix(slubs * rng.uniform(0.05, 0.35), painted, (0.5, 0.48, 0.45))
    return n.principled(faded, Roughness=0.95, Sheen_Weight=0.2, Normal=n.bump(height, 0.02))


def _cloth(rng: Rng, n: Nodes) -> Socket:
    return _cloth_of(rng, n, random_colour(rng, 0.3), rng.uniform(-np.pi, np.pi))


def _stone(rng: Rng, n: Nodes) -> Socket:
    base, where = random_colour(rng, 0.7), n.place(rng)
    other = tuple(float(c) for c in np.array(base) * rng.uniform(0.35, 0.75))
    clouds = n.step(n.noise(where, rng.uniform(3, 12), 5.0, rng.uniform(0, 1.5)), 0.3, 0.7)
    painted = n.mix(clouds * rng.uniform(0.2, 0.9), base, other)
    if rng.random() < 0.6:  # granite: grains of two minerals
        for mineral in (random_colour(rng, 0.9), random_colour(rng, 0.9)):
            grains = n.add("SeparateColor", {0: n.cells(n.place(rng), rng.uniform(90, 280))})
            painted = n.mix(n.step(grains, 0.72, 0.76), painted, mineral)
    return n.principled(painted, Roughness=rng.uniform(0.12, 0.6))


def _stripes(rng: Rng, n: Nodes) -> Socket:
    turn, period = rng.uniform(-np.pi, np.pi), rng.uniform(0.03, 0.16)
    across = n.axis(n.place(rng, turn=turn), 1)
    painted: Socket = random_colour(rng, 0.6)
    for _ in range(rng.integers(1, 4)):
        band = n.wave(across + rng.uniform(0, period), period) < rng.uniform(0.1, 0.5)
        painted = n.mix(band, painted, random_colour(rng, 0.25))
    return _cloth_of(rng, n, painted, turn)


def _checks(rng: Rng, n: Nodes) -> Socket:
    turn, period = rng.uniform(-np.pi, np.pi), rng.uniform(0.03, 0.14)
    where, half = n.place(rng, turn=turn), rng.uniform(0.3, 0.7)
    painted, accent = random_colour(rng, 0.7), random_colour(rng, 0.1)
    for i in (0, 1):
        painted = n.mix((n.wave(n.axis(where, i), period) < half) * 0.55, painted, accent)
    return _cloth_of(rng, n, painted, turn)


def _marble(rng: Rng, n: Nodes) -> Socket:
    where = n.place(rng)
    painted = colour(rng.random(), rng.uniform(0.0, 0.25), rng.choice([0.95, 0.88, 0.5, 0.12]))
    vein = random_colour(rng, 0.8)
    for scale in (rng.uniform(1, 3), rng.uniform(3, 8)):
        field = n.noise(where, scale, 6.0, rng.uniform(0.2, 1.2))
        ridge = n.step(abs(field - 0.5), rng.uniform(0.02, 0.07), 0.0)
        painted = n.mix(ridge * rng.uniform(0.3, 0.9), painted, vein)
    return n.principled(painted, Roughness=rng.uniform(0.05, 0.25))


def _terrazzo(rng: Rng, n: Nodes) -> Socket:
    painted: Socket = random_colour(rng, 0.7)
    for scale in (rng.uniform(18, 35), rng.uniform(35, 70), rng.uniform(70, 120)):
        where = n.place(rng, (1.0, rng.uniform(1.0, 1.6)))
        chip = n.add("SeparateColor", {0: n.cells(where, scale)})
        chosen = (n.cells(where, scale, out=0) < rng.uniform(0.3, 0.5)) * (chip > rng.uniform(0.3, 0.6))
        tone = n.add("SeparateColor", {0: n.cells(where, scale)}, out=1)
        painted = n.mix(chosen, painted, n.mix(tone, random_colour(rng, 0.5), random_colour(rng, 0.4)))
    return n.principled(painted, Roughness=rng.uniform(0.1, 0.4))


def _squares(n: Nodes, x: Socket, y: Socket, side: float, gap: float) -> tuple[Socket, Socket]:
    """Return the number of the square in which a point lies, as a vector, and the share of the gap around it [m]."""
    seam = n.math("MAXIMUM", n.wave(x, side), n.wave(y, side))
    return n.vector(n.whole(x, side), n.whole(y, side)), n.step(seam, 1 - gap / side, 1 - 0.4 * gap / side)


def _tiles(rng: Rng, n: Nodes) -> Socket:
    side = rng.uniform(0.018, 0.07)
    where = n.place(rng)
    across, row = n.axis(where, 0), n.whole(n.axis(where, 1), side)
    if rng.random() < 0.4:  # every second row is shifted by half a tile
        across = across + n.math("MODULO", row, 2.0) * (side / 2)
    tile, grout = _squares(n, across, n.axis(where, 1), side, 0.005)
    first, second = random_colour(rng, 0.4), random_colour(rng, 0.4)
    painted = n.mix(n.random(tile) * rng.uniform(0.15, 1.0), first, second)
    painted = n.mix(grout, painted, colour(0.1, 0.05, rng.uniform(0.3, 0.9)))
    return n.principled(painted, Roughness=rng.uniform(0.05, 0.3) + grout * 0.5, Normal=n.bump(grout, -0.001))


def _weave(rng: Rng, n: Nodes) -> Socket:
    where, strip = n.place(rng), rng.uniform(0.008, 0.028)
    x, y = n.axis(where, 0), n.axis(where, 1)
    odd = n.math("MODULO", abs(n.whole(x, strip) + n.whole(y, strip)), 2.0)
    over = odd * (1.0 - n.wave(x, strip) ** 2.0) + (1.0 - odd) * (1.0 - n.wave(y, strip) ** 2.0)
    warp, weft = random_colour(rng, 0.3), random_colour(rng, 0.3)
    if rng.random() < 0.6:
        warp, weft = _two_browns(rng)
    painted = n.mix(odd, warp, weft)
    shaded = n.mix(n.step(over, 0.0, 0.4), tuple(0.25 * c for c in warp), painted)
    return n.principled(shaded, Roughness=rng.uniform(0.5, 0.9), Normal=n.bump(over, 0.3 * strip))


def _planks(rng: Rng, n: Nodes) -> Socket:
    where, width = n.place(rng), rng.uniform(0.06, 0.15)
    board = n.whole(n.axis(where, 1), width)
    dark, light = _two_browns(rng)
    grain = _grain(rng, n, n.vector(n.axis(where, 0) + board * 3.7, n.axis(where, 1), board))
    painted = n.mix(n.random(n.vector(board, 0.0)) * rng.uniform(0.1, 0.6), n.mix(grain, dark, light), dark)
    gap = n.step(n.wave(n.axis(where, 1), width), 1 - rng.uniform(0.006, 0.014) / width, 1 - 0.003 / width)
    painted = n.mix(gap, painted, (0.01, 0.008, 0.006))
    return n.principled(painted, Roughness=rng.uniform(0.35, 0.7), Normal=n.bump(gap, -0.004))


def _lacquer(rng: Rng, n: Nodes) -> Socket:
    return n.principled(
        random_colour(rng, 0.3), Roughness=rng.uniform(0.2, 0.4), Coat_Weight=1.0,
        Coat_Roughness=rng.uniform(0.01, 0.08), Normal=n.bump(n.noise(n.place(rng), 3.0), 0.002),
    )  # fmt: skip


def _cork(rng: Rng, n: Nodes) -> Socket:
    hue, value = rng.uniform(0.06, 0.1), rng.uniform(0.5, 0.8)
    light, dark = colour(hue, rng.uniform(0.35, 0.6), value), colour(hue - 0.01, 0.6, 0.55 * value)
    where = n.place(rng)
    crumb = n.add("SeparateColor", {0: n.cells(where, rng.uniform(120, 320))})
    painted = n.mix(crumb * rng.uniform(0.3, 0.9), light, dark)
    flecks = n.step(n.noise(n.place(rng, (1.0, rng.uniform(1.0, 2.5))), rng.uniform(60, 140), 4.0), 0.6, 0.66)
    painted = n.mix(flecks * rng.uniform(0.5, 0.95), painted, colour(0.06, 0.6, 0.18))
    return n.principled(painted, Roughness=rng.uniform(0.7, 0.95), Normal=n.bump(crumb, 0.0004))


def _brushed_metal(rng: Rng, n: Nodes) -> Socket:
    tint = colour(rng.choice([0.6, 0.09]), rng.uniform(0.0, 0.12), rng.uniform(0.6, 0.85))
    streaks = n.noise(n.place(rng, (rng.uniform(1, 4), rng.uniform(150, 400))), 1.0, 4.0)
    rough = rng.uniform(0.25, 0.4) + streaks * 0.2
    painted = n.mix(streaks * rng.uniform(0.2, 0.6), tint, tuple(0.6 * c for c in tint))
    return n.principled(painted, Metallic=1.0, Roughness=rough, Normal=n.bump(streaks, 0.0002))


def _leather(rng: Rng, n: Nodes) -> Socket:
    where = n.place(rng)
    base = colour(rng.uniform(0.02, 0.09), rng.uniform(0.3, 0.75), rng.uniform(0.15, 0.65))
    if rng.random() < 0.4:
        base = random_colour(rng, 0.3)
    bent = n.add("Mapping", {"Vector": where, "Scale": (1.0, rng.uniform(1.0, 1.5), 1.0)})
    crease = n.step(n.cells(bent, rng.uniform(120, 300), out=0, feature="DISTANCE_TO_EDGE"), 0.12, 0.0)
    worn = n.step(n.noise(where, rng.uniform(2, 8), 4.0, 0.8), 0.35, 0.7)
    painted = n.mix(worn * rng.uniform(0.1, 0.6), base, tuple(0.5 * c for c in base))
    painted = n.mix(crease * 0.5, painted, tuple(0.3 * c for c in base))
    return n.principled(painted, Roughness=rng.uniform(0.35, 0.6), Normal=n.bump(crease, -0.0006))


def _bamboo_mat(rng: Rng, n: Nodes) -> Socket:
    slat, where = rng.uniform(0.004, 0.012), n.place(rng)
    along, across = n.axis(where, 0), n.axis(where, 1)
    number = n.whole(across, slat)
    dark, light = _two_browns(rng)
    if rng.random() < 0.3:  # dyed
        light, dark = random_colour(rng, 0.4), random_colour(rng, 0.4)
    painted = n.mix(n.random(n.vector(number, 0.5)), light, dark)
    node = n.step(n.wave(along + n.random(n.vector(number, 1.5)) * 5.0, rng.uniform(0.2, 0.4)), 0.985, 1.0)
    painted = n.mix(node * 0.7, painted, tuple(0.4 * c for c in dark))
    flank = n.wave(across, slat)  # 0 in the middle of a slat, 1 between two
    painted = n.mix(n.step(flank, 0.8, 0.97), painted, (0.01, 0.008, 0.006))
    tie = n.step(n.wave(along, rng.uniform(0.05, 0.16)), 0.955, 0.98)
    painted = n.mix(tie, painted, random_colour(rng, 0.6))
    return n.principled(painted, Roughness=rng.uniform(0.4, 0.75), Normal=n.bump(1.0 - flank**2.0, 0.25 * slat))


def _slate(rng: Rng, n: Nodes) -> Socket:
    where = n.place(rng)
    base = colour(rng.choice([0.58, 0.4, 0.85, 0.08]), rng.uniform(0.03, 0.25), rng.uniform(0.2, 0.5))
    layers = float(rng.integers(4, 9))
    field = n.noise(where, rng.uniform(1.5, 4), 5.0, rng.uniform(0.3, 1.0)) * layers
    level = n.math("FLOOR", field)
    step = level + n.step(n.math("FRACT", field), 0.85, 1.0)
    tone = n.random(n.vector(level, rng.uniform(0, 9)))
    painted = n.mix(tone * rng.uniform(0.2, 0.7), base, tuple(1.6 * c for c in base))
    dust = n.step(n.noise(n.place(rng), rng.uniform(10, 40), 5.0), 0.5, 0.8)
    painted = n.mix(dust * 0.3, painted, colour(0.08, 0.15, 0.6))
    return n.principled(painted, Roughness=rng.uniform(0.35, 0.7), Normal=n.bump(step, 0.0012))


def _pebbles(rng: Rng, n: Nodes) -> Socket:
    where, scale = n.place(rng, (1.0, rng.uniform(1.0, 1.5))), rng.uniform(25, 70)
    edge = n.cells(where, scale, out=0, feature="DISTANCE_TO_EDGE")
    cell = n.cells(where, scale)
    first, second = (n.add("SeparateColor", {0: cell}, out=i) for i in (0, 1))
    stones = [random_colour(rng, 0.85) for _ in range(3)]
    painted = n.mix(n.step(first, 0.3, 0.7), n.mix(second, *stones[:2]), stones[2])
    mortar = n.step(edge, rng.uniform(0.05, 0.12), 0.02)
    painted = n.mix(mortar, painted, colour(0.1, 0.08, rng.uniform(0.25, 0.85)))
    rough, height = rng.uniform(0.1, 0.4) + mortar * 0.4, n.step(edge, 0.0, 0.3)
    return n.principled(painted, Roughness=rough, Normal=n.bump(height, 0.12 / scale))


def _from_centre(rng: Rng, n: Nodes) -> Socket:
    """Return the place [m] from the table's centre, turned at random."""
    centred = n.add("Mapping", {"Vector": n.add("NewGeometry"), "Location": (-0.5, -0.5, 0.0)}, vector_type="POINT")
    return n.add("Mapping", {"Vector": centred, "Rotation": (0.0, 0.0, rng.uniform(-np.pi, np.pi))})


def _resin(rng: Rng, n: Nodes) -> Socket:
    """Make two slabs of wood with their natural edges, joined by a river of coloured resin."""
    where, (dark, light) = _from_centre(rng, n), _two_browns(rng)
    painted = n.mix(_grain(rng, n, where), dark, light)
    bends = n.noise(n.place(rng), rng.uniform(1.5, 4), 4.0) * rng.uniform(0.15, 0.4)
    middle = (n.axis(where, 1) - rng.uniform(-0.2, 0.2)) + (bends - 0.15)
    away = abs(middle) - rng.uniform(0.03, 0.12)  # [m] from the river's bank
    painted = n.mix(n.step(away, 0.02, 0.0), painted, tuple(0.25 * c for c in dark))
    swirls = n.step(n.noise(n.place(rng), rng.uniform(4, 12), 4.0, 2.0), 0.35, 0.7)
    resin = n.mix(swirls, random_colour(rng, 0.1), random_colour(rng, 0.2))
    river = n.step(away, 0.001, -0.001)
    return n.principled(
        n.mix(river, painted, resin), Roughness=rng.uniform(0.3, 0.5),
        Coat_Weight=n.math("MAXIMUM", river, float(rng.random() < 0.5)), Coat_Roughness=rng.uniform(0.02, 0.1),
    )  # fmt: skip


def _bordered(rng: Rng, n: Nodes) -> Socket:
    """Make a cloth with woven borders along its edges; beyond one edge the wooden table shows."""
    where, painted = _from_centre(rng, n), random_colour(rng, 0.5)
    reach = rng.uniform(0.2, 0.45), rng.uniform(0.55, 0.8)  # [m] from the centre to the cloth's edges
    depth = n.math("MINIMUM", *(r - abs(n.axis(where, i)) for i, r in enumerate(reach)))  # [m] from the nearest edge
    for _ in range(rng.integers(1, 4)):
        band = abs(depth - rng.uniform(0.02, 0.14)) < rng.uniform(0.003, 0.02)
        painted = n.mix(band, painted, random_colour(rng, 0.15))
    cloth = _cloth_of(rng, n, painted, 0.0)
    return n.add("MixShader", {0: depth > 0.0, 1: _wood(rng, n), 2: cloth})


def _end_grain(rng: Rng, n: Nodes) -> Socket:
    where, side = n.place(rng), rng.uniform(0.05, 0.13)
    y = n.axis(where, 1)
    x = n.axis(where, 0) + n.random(n.vector(n.whole(y, side), 0.5)) * side
    block, seam = _squares(n, x, y, side, 0.004)
    centre = n.add("VectorMath", {0: n.random(block, 1), 1: (2.5, 2.5, 0.0), 2: block}, operation="MULTIPLY_ADD")
    away = n.add("VectorMath", {0: n.vector(x / side, y / side), 1: centre}, out=1, operation="DISTANCE")
    rings = n.wave(away + n.noise(where, 30.0) * 0.4, rng.uniform(0.25, 0.5)) * rng.uniform(0.5, 1.0)
    dark, light = _two_browns(rng)
    painted = n.mix(n.random(block) * rng.uniform(0.3, 0.8), n.mix(rings, light, dark), dark)
    return n.principled(n.mix(seam, painted, tuple(0.3 * c for c in dark)), Roughness=rng.uniform(0.3, 0.6))


def _peeling_paint(rng: Rng, n: Nodes) -> Socket:
    painted, height = n.mix(_grain(rng, n, n.place(rng)), *_two_browns(rng)), 0.0
    where, scale, warp = n.place(rng, (1.0, rng.uniform(1.0, 3.0))), rng.uniform(2, 7), rng.uniform(0, 1)
    field, limit = n.noise(where, scale, 9.0, warp), rng.uniform(0.38, 0.48)
    for low in (limit, limit + rng.uniform(0.03, 0.1)):
        coat = n.step(field, low, low + 0.006)
        painted, height = n.mix(coat, painted, random_colour(rng, 0.4)), height + coat
    return n.principled(painted, Roughness=rng.uniform(0.4, 0.8), Normal=n.bump(height, 0.001))


def _zinc(rng: Rng, n: Nodes) -> Socket:
    grey = colour(0.6, rng.uniform(0.02, 0.12), rng.uniform(0.5, 0.85))
    crystal = n.add("SeparateColor", {0: n.cells(n.place(rng, (1.0, rng.uniform(1.0, 2.0))), rng.uniform(10, 30))})
    painted = n.mix(crystal * rng.uniform(0.5, 1.0), grey, tuple(0.3 * c for c in grey))
    where, low = n.place(rng), rng.uniform(0.5, 0.65)
    rust = n.step(n.noise(where, rng.uniform(3, 10), 6.0, 0.6), low, low + 0.06)
    painted = n.mix(rust * rng.uniform(0.2, 0.7), painted, colour(0.1, 0.05, rng.uniform(0.2, 0.9)))
    scale, radius = rng.uniform(3, 6), rng.uniform(0.028, 0.042)  # cells a metre, and of a glass's foot [m]
    ring = n.step(abs(n.cells(where, scale, out=0) - radius * scale), 0.006 * scale, 0.0)
    painted = n.mix(ring * 0.6, painted, tuple(0.3 * c for c in grey))
    return n.principled(painted, Metallic=0.6, Roughness=rng.uniform(0.3, 0.6))


def _oilcloth(rng: Rng, n: Nodes) -> Socket:
    painted: Socket = random_colour(rng, 0.6)
    leaf = colour(rng.uniform(0.2, 0.42), rng.uniform(0.4, 0.8), rng.uniform(0.3, 0.7))
    fruits = (colour(rng.uniform(-0.1, 0.17), rng.uniform(0.6, 0.95), rng.uniform(0.5, 0.95)) for _ in range(2))
    for tint, long in ((leaf, 2.4), *((fruit, rng.uniform(1, 1.4)) for fruit in fruits)):
        away = n.cells(n.place(rng, (1.0, long)), rng.uniform(5, 13), out=0)
        shaded = n.mix(n.step(away, 0.0, 0.3), tint, tuple(0.4 * c for c in tint))
        painted = n.mix(n.step(away, 0.3, 0.28), painted, shaded)
    folds = n.bump(_folds(rng, n, rng.uniform(-np.pi, np.pi)), 0.008)
    return n.principled(painted, Roughness=0.4, Coat_Weight=1.0, Coat_Roughness=rng.uniform(0.05, 0.2), Normal=folds)


def _encaustic_tiles(rng: Rng, n: Nodes) -> Socket:
    where, side = n.place(rng), rng.uniform(0.08, 0.22)
    x, y = n.axis(where, 0), n.axis(where, 1)
    a, b = n.wave(x, side), n.wave(y, side)  # 0 in the middle of a tile, 1 at its edges
    vectors = n.vector(a, b), n.vector(1.0 - a, 1.0 - b)
    fields = [n.add("VectorMath", {0: v}, out=1, operation="LENGTH") for v in vectors]
    fields += [a + b, n.math("MAXIMUM", a, b), abs(a - b)]
    painted: Socket = random_colour(rng, 0.6)
    for i in rng.permutation(5)[: rng.integers(2, 5)]:
        band = abs(fields[i] - rng.uniform(0.0, 0.8)) < rng.uniform(0.06, 0.25)
        painted = n.mix(band, painted, random_colour(rng, 0.3))
    worn = n.noise(where, rng.uniform(5, 30), 5.0) * rng.uniform(0.1, 0.5)
    _, seam = _squares(n, x, y, side, 0.003)
    painted = n.mix(seam, n.mix(worn, painted, (0.45, 0.42, 0.38)), (0.2, 0.19, 0.17))
    return n.principled(painted, Roughness=rng.uniform(0.25, 0.7))


def _linoleum(rng: Rng, n: Nodes) -> Socket:
    where, painted = n.place(rng, (1.0, rng.uniform(2.5, 5.0))), random_colour(rng, 0.3)
    for _ in range(3):
        streaks, low = n.noise(where, rng.uniform(2, 6), 4.0, rng.uniform(0.8, 2.5)), rng.uniform(0.45, 0.6)
        share = n.step(streaks, low, low + 0.08) * rng.uniform(0.3, 0.9)
        painted = n.mix(share, painted, random_colour(rng, 0.4))
    return n.principled(painted, Roughness=rng.uniform(0.25, 0.5))


def _cane(rng: Rng, n: Nodes) -> Socket:
    where, pitch, height = n.place(rng), rng.uniform(0.035, 0.09), 0.0
    (_, dark), (_, light) = _two_browns(rng), _two_browns(rng)
    painted: Socket = random_colour(rng, 0.3) if rng.random() < 0.4 else tuple(0.15 * c for c in dark)
    for turn in np.arange(3) * np.pi / 3:
        across = n.axis(n.add("Mapping", {"Vector": where, "Rotation": (0.0, 0.0, float(turn))}), 1)
        strand = n.step(n.wave(across, pitch), 0.6, 0.7)
        tone = n.random(n.vector(n.math("ROUND", across / pitch), turn))
        painted = n.mix(strand, painted, n.mix(tone * 0.6, light, tuple(0.5 * c for c in light)))
        height = n.math("MAXIMUM", height, strand)
    return n.principled(painted, Roughness=rng.uniform(0.4, 0.7), Normal=n.bump(height, 0.003))


def _kilim(rng: Rng, n: Nodes) -> Socket:
    turn, steps = rng.uniform(-np.pi, np.pi), float(rng.integers(4, 7))
    where, periods = n.place(rng, turn=turn), rng.uniform(0.12, 0.4, 2)
    x, y = (n.math("FLOOR", n.wave(n.axis(where, i), periods[i]) * steps) for i in (0, 1))
    painted: Socket = random_colour(rng, 0.3)
    for level in range(1, int(2 * steps) - 1):
        painted = n.mix(x + y > level - 0.5, painted, random_colour(rng, 0.3))
    return _cloth_of(rng, n, painted, turn)


def _chipboard(rng: Rng, n: Nodes) -> Socket:
    dark, light = _two_browns(rng)
    painted, scale = dark, rng.uniform(10, 25)
    for _ in range(5):
        cell = n.cells(n.place(rng, (0.5, rng.uniform(1.5, 4.0))), scale)
        tone, drawn = (n.add("SeparateColor", {0: cell}, out=i) for i in (0, 1))
        painted = n.mix(drawn > 0.5, painted, n.mix(tone, light, dark))
    return n.principled(painted, Roughness=rng.uniform(0.4, 0.8))


FAMILIES: dict[str, dict[str, Callable[[Rng, Nodes], Socket]]] = {
    "taught": {"wood": _wood, "cloth": _cloth, "stone": _stone},
    "held_out": {
        "stripes": _stripes, "checks": _checks, "marble": _marble, "terrazzo": _terrazzo, "tiles": _tiles,
        "weave": _weave, "planks": _planks, "lacquer": _lacquer,
        "cork": _cork, "brushed metal": _brushed_metal, "leather": _leather,
        "bamboo mat": _bamboo_mat, "slate": _slate, "pebbles": _pebbles, "resin": _resin, "bordered cloth": _bordered,
    },
    "sealed": {
        "end grain": _end_grain, "peeling paint": _peeling_paint, "zinc": _zinc, "oilcloth": _oilcloth,
        "encaustic tiles": _encaustic_tiles, "linoleum": _linoleum, "cane": _cane, "kilim": _kilim,
        "chipboard": _chipboard,
    },
}  # fmt: skip
