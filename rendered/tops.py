"""Make table tops as Blender's shader nodes, of kinds that are `taught` and kinds that are `held_out`."""

from collections.abc import Callable
from typing import Any

import numpy as np

from rendered.finishes import colour, random_colour
from rendered.nodes import Nodes, Socket

Rng = np.random.Generator


def table_top(rng: Rng, family: str) -> Any:
    """Draw the material of a table top of this family."""
    n = Nodes(f"top {family}")
    return n.finish(TOPS[family](rng, n))


def _two_browns(rng: Rng) -> tuple[tuple, tuple]:
    """Draw a dark and a light tone of one wood."""
    hue, saturation, value = rng.uniform(0.04, 0.105), rng.uniform(0.25, 0.65), rng.uniform(0.4, 0.9)
    return colour(hue, saturation, value * rng.uniform(0.55, 0.85)), colour(hue, saturation * 0.85, value)


def _grain(rng: Rng, n: Nodes, where: Socket) -> Socket:
    """Return the share of light wood: wide figure and fine pores along x."""
    figure = n.noise(n.add("Mapping", {"Vector": where, "Scale": (0.6, rng.uniform(7, 16), 1.0)}), 1.0, 3.0, 0.5)
    rings = n.wave(n.math("ADD", n.axis(where, 1), n.math("MULTIPLY", figure, 0.25)), rng.uniform(0.03, 0.09))
    pores = n.noise(n.add("Mapping", {"Vector": where, "Scale": (6.0, 160.0, 1.0)}), 1.0)
    strength = rng.uniform(0.2, 0.7)
    both = n.math("ADD", n.math("MULTIPLY", rings, strength), n.math("MULTIPLY", pores, 1 - strength))
    return n.step(both, 0.2, 0.75)


def _wood(rng: Rng, n: Nodes) -> Socket:
    dark, light = _two_browns(rng)
    grain = _grain(rng, n, n.place(rng))
    return n.principled(
        n.mix(grain, dark, light), Roughness=rng.uniform(0.3, 0.6), Coat_Weight=float(rng.random() < 0.35),
        Coat_Roughness=rng.uniform(0.1, 0.3),
    )  # fmt: skip


def _folds(rng: Rng, n: Nodes, turn: float) -> Socket:
    """Return the height of a cloth: soft wrinkles, and in some the creases in which it was folded."""
    wrinkles = n.math("MULTIPLY", n.noise(n.place(rng), rng.uniform(2, 6), 2.0, 1.0), rng.uniform(0.0, 1.0))
    if rng.random() < 0.5:
        return wrinkles
    where, period = n.place(rng, turn=turn), rng.uniform(0.22, 0.45)
    creases = [n.step(n.wave(n.axis(where, i), period), 0.88, 1.0) for i in (0, 1)]
    return n.math("ADD", wrinkles, n.math("MULTIPLY", n.math("ADD", *creases), rng.uniform(0.05, 0.2)))


def _cloth_of(rng: Rng, n: Nodes, painted: Socket, turn: float) -> Socket:
    """Return a cloth in these colours: threads, wrinkles, no gloss."""
    where = n.place(rng, turn=turn)
    threads = [n.wave(n.axis(where, i), 0.0025) for i in (0, 1)]
    slubs = n.noise(n.place(rng, (1.0, 12.0), turn), 40.0)
    height = n.math("ADD", _folds(rng, n, turn), n.math("MULTIPLY", n.math("ADD", *threads), 0.01))
    faded = n.mix(n.math("MULTIPLY", slubs, rng.uniform(0.05, 0.35)), painted, (0.5, 0.48, 0.45))
    return n.principled(faded, Roughness=0.95, Sheen_Weight=0.2, Normal=n.bump(height, 0.02))


def _cloth(rng: Rng, n: Nodes) -> Socket:
    return _cloth_of(rng, n, random_colour(rng, 0.3), rng.uniform(-np.pi, np.pi))


def _stone(rng: Rng, n: Nodes) -> Socket:
    base, where = random_colour(rng, 0.7), n.place(rng)
    other = tuple(float(c) for c in np.array(base) * rng.uniform(0.35, 0.75))
    clouds = n.step(n.noise(where, rng.uniform(3, 12), 5.0, rng.uniform(0, 1.5)), 0.3, 0.7)
    painted = n.mix(n.math("MULTIPLY", clouds, rng.uniform(0.2, 0.9)), base, other)
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
        shifted = n.math("ADD", across, rng.uniform(0, period))
        band = n.math("LESS_THAN", n.wave(shifted, period), rng.uniform(0.1, 0.5))
        painted = n.mix(band, painted, random_colour(rng, 0.25))
    return _cloth_of(rng, n, painted, turn)


def _checks(rng: Rng, n: Nodes) -> Socket:
    turn, period = rng.uniform(-np.pi, np.pi), rng.uniform(0.03, 0.14)
    where, half = n.place(rng, turn=turn), rng.uniform(0.3, 0.7)
    ground, accent = random_colour(rng, 0.7), random_colour(rng, 0.1)
    painted: Socket = ground
    for i in (0, 1):
        band = n.math("LESS_THAN", n.wave(n.axis(where, i), period), half)
        painted = n.mix(n.math("MULTIPLY", band, 0.55), painted, accent)
    return _cloth_of(rng, n, painted, turn)


def _marble(rng: Rng, n: Nodes) -> Socket:
    where = n.place(rng)
    base = colour(rng.random(), rng.uniform(0.0, 0.25), rng.choice([0.95, 0.88, 0.5, 0.12]))
    vein = random_colour(rng, 0.8)
    painted: Socket = base
    for scale in (rng.uniform(1, 3), rng.uniform(3, 8)):
        field = n.noise(where, scale, 6.0, rng.uniform(0.2, 1.2))
        ridge = n.step(n.math("ABSOLUTE", n.math("SUBTRACT", field, 0.5)), rng.uniform(0.02, 0.07), 0.0)
        painted = n.mix(n.math("MULTIPLY", ridge, rng.uniform(0.3, 0.9)), painted, vein)
    return n.principled(painted, Roughness=rng.uniform(0.05, 0.25))


def _terrazzo(rng: Rng, n: Nodes) -> Socket:
    painted: Socket = random_colour(rng, 0.7)
    for scale in (rng.uniform(18, 35), rng.uniform(35, 70), rng.uniform(70, 120)):
        where = n.place(rng, (1.0, rng.uniform(1.0, 1.6)))
        chip = n.add("SeparateColor", {0: n.cells(where, scale)})
        inside = n.math("LESS_THAN", n.cells(where, scale, out=0), rng.uniform(0.3, 0.5))
        chosen = n.math("MULTIPLY", inside, n.math("GREATER_THAN", chip, rng.uniform(0.3, 0.6)))
        tone = n.add("SeparateColor", {0: n.cells(where, scale)}, out=1)
        painted = n.mix(chosen, painted, n.mix(tone, random_colour(rng, 0.5), random_colour(rng, 0.4)))
    return n.principled(painted, Roughness=rng.uniform(0.1, 0.4))


def _tiles(rng: Rng, n: Nodes) -> Socket:
    side = rng.uniform(0.018, 0.07)
    where = n.place(rng)
    across, row = n.axis(where, 0), n.whole(n.axis(where, 1), side)
    if rng.random() < 0.4:  # every second row is shifted by half a tile
        across = n.math("ADD", across, n.math("MULTIPLY", n.math("MODULO", row, 2.0), side / 2))
    tone = n.random(n.vector(n.whole(across, side), row))
    first, second = random_colour(rng, 0.4), random_colour(rng, 0.4)
    painted = n.mix(n.math("MULTIPLY", tone, rng.uniform(0.15, 1.0)), first, second)
    seam = n.math("MAXIMUM", n.wave(across, side), n.wave(n.axis(where, 1), side))
    grout = n.step(seam, 1 - 0.005 / side, 1 - 0.002 / side)
    painted = n.mix(grout, painted, colour(0.1, 0.05, rng.uniform(0.3, 0.9)))
    rough = n.math("ADD", rng.uniform(0.05, 0.3), n.math("MULTIPLY", grout, 0.5))
    return n.principled(painted, Roughness=rough, Normal=n.bump(grout, -0.001))


def _weave(rng: Rng, n: Nodes) -> Socket:
    where, strip = n.place(rng), rng.uniform(0.008, 0.028)
    x, y = n.axis(where, 0), n.axis(where, 1)
    odd = n.math("MODULO", n.math("ABSOLUTE", n.math("ADD", n.whole(x, strip), n.whole(y, strip))), 2.0)
    arcs = [n.math("SUBTRACT", 1.0, n.math("POWER", n.wave(v, strip), 2.0)) for v in (x, y)]
    over = n.math("ADD", n.math("MULTIPLY", odd, arcs[0]), n.math("MULTIPLY", n.math("SUBTRACT", 1.0, odd), arcs[1]))
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
    shifted = n.vector(n.math("ADD", n.axis(where, 0), n.math("MULTIPLY", board, 3.7)), n.axis(where, 1), board)
    grain = _grain(rng, n, shifted)
    tone = n.random(n.vector(board, 0.0))
    painted = n.mix(n.math("MULTIPLY", tone, rng.uniform(0.1, 0.6)), n.mix(grain, dark, light), dark)
    gap = n.step(n.wave(n.axis(where, 1), width), 1 - rng.uniform(0.006, 0.014) / width, 1 - 0.003 / width)
    painted = n.mix(gap, painted, (0.01, 0.008, 0.006))
    return n.principled(painted, Roughness=rng.uniform(0.35, 0.7), Normal=n.bump(gap, -0.004))


def _lacquer(rng: Rng, n: Nodes) -> Socket:
    return n.principled(
        random_colour(rng, 0.3), Roughness=rng.uniform(0.2, 0.4), Coat_Weight=1.0,
        Coat_Roughness=rng.uniform(0.01, 0.08), Normal=n.bump(n.noise(n.place(rng), 3.0), 0.002),
    )  # fmt: skip


FAMILIES = {
    "taught": ("wood", "cloth", "stone"),
    "held_out": ("stripes", "checks", "marble", "terrazzo", "tiles", "weave", "planks", "lacquer"),
}
TOPS: dict[str, Callable[[Rng, Nodes], Socket]] = {
    "wood": _wood, "cloth": _cloth, "stone": _stone, "stripes": _stripes, "checks": _checks, "marble": _marble,
    "terrazzo": _terrazzo, "tiles": _tiles, "weave": _weave, "planks": _planks, "lacquer": _lacquer,
}  # fmt: skip
