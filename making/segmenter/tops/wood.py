"""Table tops of wood; boards run along x."""

import cv2
import numpy as np

from making.segmenter.paint import (
    FRACTION_BITS,
    Colour,
    Field,
    Number,
    Top,
    blend,
    colour,
    dried,
    grid,
    ink,
    near,
    noise,
    points,
    ramp,
    sheet,
    step,
    wood,
)


def grain(rng: np.random.Generator, side: int) -> Field:
    """Return the streaks of straight grain, from 0 to 1: fine fibres over broad bands."""
    fibres = noise(rng, side, rng.uniform(60, 160), 2, 0.7, stretch=rng.uniform(12, 40))
    bands = noise(rng, side, rng.uniform(5, 25), 2, 0.6, stretch=rng.uniform(4, 15))
    return np.clip(0.5 + rng.uniform(0.05, 0.25) * fibres + rng.uniform(0.05, 0.3) * bands, 0, 1)


def wood_shades(rng: np.random.Generator) -> list[Colour]:
    """Draw the dark and the light colour of one wood."""
    light = wood(rng)
    return [light * rng.uniform(0.45, 0.9) * np.array([1, 0.96, 0.92], np.float32), light]


def boards(rng: np.random.Generator, side: int, rows: float, lengths: tuple[Number, Number]) -> tuple[Field, Field]:
    """Return a random number from 0 to 1 for each board of a floor, and each pixel's distance from its edge."""
    x, y = grid(side)
    row = np.floor(y * rows).astype(int)
    length = rng.uniform(*lengths, row.max() + 1)[row].astype(np.float32)
    along = x / length + rng.random(row.max() + 1)[row].astype(np.float32)
    number = rng.random(4096).astype(np.float32)[(row * 97 + np.floor(along).astype(int) * 31) % 4096]
    across = np.abs((y * rows) % 1 - 0.5)
    to_end = (0.5 - np.abs(along % 1 - 0.5)) * length
    return number, np.minimum((0.5 - across) / rows, to_end)


def planks(rng: np.random.Generator, side: int) -> Top:
    """Draw planks side by side, each with a shade and grain of its own."""
    number, edge = boards(rng, side, rng.uniform(4, 16), (0.5, 3))
    field = grain(rng, side)
    rows = (np.arange(side)[:, None] + (number * side).astype(int)) % side
    field = np.take_along_axis(field, rows, 0)
    picture = ramp(field, wood_shades(rng)) * (1 + rng.uniform(0.1, 0.6) * (number - 0.5))[..., None]
    gap = 1 - step(edge - rng.uniform(0, 0.002), 0.004)
    return blend(picture, picture * rng.uniform(0.15, 0.8), gap * rng.uniform(0.4, 1))


def straight_grain(rng: np.random.Generator, side: int) -> Top:
    """Draw one board with straight grain."""
    return ramp(grain(rng, side), wood_shades(rng))


def butcher_block(rng: np.random.Generator, side: int) -> Top:
    """Draw glued staves of many shades."""
    number, edge = boards(rng, side, rng.uniform(20, 45), (0.15, 0.6))
    dark, light = wood_shades(rng)
    field = np.clip(number + 0.3 * (grain(rng, side) - 0.5), 0, 1)
    picture = ramp(field, [dark, near(rng, light, 0.1), light])
    return blend(picture, picture * 0.6, (1 - step(edge, 0.003)) * rng.uniform(0, 0.7))


def cathedral_grain(rng: np.random.Generator, side: int) -> Top:
    """Draw a board cut through its rings: nested arches and knots."""
    x, y = grid(side)
    centre = rng.uniform(-0.3, 1.3, 2)
    depth = np.hypot((y - centre[1]) * rng.uniform(1.5, 4), (x - centre[0]) * rng.uniform(0.2, 0.8))
    for knot in rng.uniform(0, 1, (rng.integers(0, 5), 2)):
        near_knot = np.exp(-(((x - knot[0]) / 0.08) ** 2 + ((y - knot[1]) / 0.04) ** 2))
        depth = depth + rng.uniform(0.1, 0.4) * near_knot
    depth = depth + 0.02 * noise(rng, side, 6, 3, stretch=5)
    rings = (depth * rng.uniform(8, 40)) % 1
    field = np.clip(rings ** rng.uniform(0.7, 3) + 0.15 * (grain(rng, side) - 0.5), 0, 1)
    return ramp(field, wood_shades(rng)[::-1])


def bamboo(rng: np.random.Generator, side: int) -> Top:
    """Draw narrow strips of bamboo with their nodes."""
    x, y = grid(side)
    strips = rng.uniform(25, 60)
    row = np.floor(y * strips).astype(int)
    shift = rng.random(row.max() + 1)[row].astype(np.float32)
    node = np.abs((x * rng.uniform(2, 6) + shift) % 1 - 0.5)
    light = colour(rng, (0.1, 0.14), (0.25, 0.55), (0.6, 0.95))
    picture = ramp(np.clip(shift * 0.5 + 0.5 * grain(rng, side), 0, 1), [light * 0.8, light])
    return (
        picture
        * (1 - 0.3 * np.exp(-((node / 0.012) ** 2)) - 0.2 * step(np.abs((y * strips) % 1 - 0.5) - 0.42, 0.05))[
            ..., None
        ]
    )


def chipboard(rng: np.random.Generator, side: int) -> Top:
    """Draw pressed flakes of wood, each at an angle of its own."""
    base = wood(rng)
    picture = sheet(base * np.float32(0.7), side)
    length, breadth = rng.uniform(0.02, 0.08), rng.uniform(0.006, 0.03)
    for _ in range(int(min(1.6 / (length * breadth), 700))):
        turn, size = rng.uniform(0, np.pi), np.array([length * rng.uniform(0.5, 1.5), breadth]) * side / 2
        axis = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]) * size[:, None]
        corners = rng.uniform(0, side, 2) + np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) @ axis
        cv2.fillConvexPoly(picture, points(corners), ink(near(rng, base, 0.15)), cv2.LINE_AA, FRACTION_BITS)
    return dried(picture) * (1 + 0.05 * noise(rng, side, 100))[..., None]


def worn_paint(rng: np.random.Generator, side: int) -> Top:
    """Draw painted boards whose wood shows where the paint has gone."""
    paint = colour(rng, saturation=(0, 0.6), value=(0.3, 0.95))
    under = planks(rng, side)
    gone = step(noise(rng, side, 12, 4, 0.7, stretch=6) - rng.uniform(0.3, 1.5), 0.3)
    light = 0.8 + 0.4 * np.clip(under.mean(2) / max(float(under.mean()), 0.05), 0.4, 1.2) / 1.2
    return blend(paint * light[..., None], under, gone)


def herringbone(rng: np.random.Generator, side: int) -> Top:
    """Draw a herringbone parquet."""
    x, y = grid(side)
    n, ratio = rng.uniform(12, 40), int(rng.integers(3, 6))
    column, row = np.floor(x * n).astype(int), np.floor(y * n).astype(int)
    phase = (column - row) % (2 * ratio)
    lies = phase < ratio
    start = np.where(lies, column - phase, row - (2 * ratio - 1 - phase))
    number = rng.random(8192).astype(np.float32)[(start * 131 + np.where(lies, row, column) * 71 + lies * 17) % 8192]
    across = np.where(lies, (y * n) % 1, (x * n) % 1)
    along = np.where(lies, phase + (x * n) % 1, (2 * ratio - 1 - phase) + (y * n) % 1)
    edge = np.minimum(np.minimum(across, 1 - across), np.minimum(along, ratio - along))
    field = grain(rng, side)
    streaks = np.where(lies, field, field.T)
    picture = ramp(np.clip(0.6 * streaks + 0.4 * number, 0, 1), wood_shades(rng))
    seam = (1 - step(edge, 0.15)).astype(np.float32)
    return blend(picture, picture * 0.4, seam * rng.uniform(0.2, 0.9))


TAUGHT = (straight_grain, planks, butcher_block, cathedral_grain, bamboo, chipboard, worn_paint)
HELD_OUT = (herringbone,)
