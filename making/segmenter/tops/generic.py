"""Table tops of no material: random pictures with the statistics of many."""

import cv2
import numpy as np

from making.segmenter.paint import (
    FRACTION_BITS,
    Field,
    Top,
    bend,
    colour,
    dried,
    flat,
    grid,
    ink,
    near,
    noise,
    points,
    ramp,
    shades,
    sheet,
)

COARSE = 2  # random networks are computed on a grid coarser by this factor


def dead_leaves(rng: np.random.Generator, side: int) -> Top:
    """Draw shapes that hide one another, with sizes by a power law (the dead leaves model of natural images)."""
    picture = sheet(colour(rng), side)
    colours, small = shades(rng, 3, 5), side * rng.uniform(0.008, 0.03)
    kind, alike = rng.integers(3), rng.uniform(0.02, 0.3)
    sizes = np.sort(small * (1 - rng.random(int(rng.integers(60, 350)))) ** (-1 / rng.uniform(1, 2.5)))[::-1]
    for size in np.minimum(sizes, side * 0.4):
        centre, turn, aspect = rng.uniform(0, side, 2), rng.uniform(0, 180), rng.uniform(0.3, 1)
        shade = ink(near(rng, colours[rng.integers(len(colours))], alike))
        if kind == 0:
            whole = points(centre).tolist(), points([size, size * aspect]).tolist(), turn, 0, 360
            cv2.ellipse(picture, *whole, shade, -1, cv2.LINE_AA, FRACTION_BITS)
        else:
            angles = np.sort(rng.uniform(0, 2 * np.pi, 4 if kind == 1 else 9)) + np.radians(turn)
            corners = centre + size * np.stack([np.cos(angles), aspect * np.sin(angles)], -1)
            cv2.fillPoly(picture, [points(corners)], shade, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def random_network(rng: np.random.Generator, side: int) -> Top:
    """Draw the output of a small random network whose inputs are a pixel's place and some noise."""
    fine = side // COARSE
    x, y = grid(fine)
    inputs = [x - 0.5, y - 0.5, np.hypot(x - rng.random(), y - rng.random()), 0.1 * noise(rng, fine, 6, 2)]
    layer = np.stack(inputs, -1) * np.float32(rng.uniform(4, 40))
    for width in (10, 10, 3):
        weights = rng.normal(0, 1.2 / np.sqrt(layer.shape[-1]), (layer.shape[-1], width)).astype(np.float32)
        mixed = layer @ weights + rng.normal(0, 1, width).astype(np.float32)
        layer = np.sin(mixed * np.float32(rng.uniform(0.7, 2))) if rng.random() < 0.6 else np.tanh(mixed)
    picture = np.clip(0.5 + 0.4 * layer, 0, 1)
    tone = colour(rng)
    picture = tone + (picture - tone) * np.float32(rng.uniform(0.2, 0.9))
    return cv2.resize(picture, (side, side), interpolation=cv2.INTER_CUBIC)


def wallpaper(rng: np.random.Generator, side: int) -> Top:
    """Draw a random picture, repeated or mirrored as on wallpaper, oilcloth or carpets."""
    n = int(rng.integers(2, 10))
    source = dead_leaves if rng.random() < 0.5 else random_network
    tile = cv2.resize(source(rng, side), (side // n + 1,) * 2, interpolation=cv2.INTER_AREA)
    if rng.random() < 0.6:
        tile = np.hstack([tile, tile[:, ::-1]])
    if rng.random() < 0.6:
        tile = np.vstack([tile, tile[::-1]])
    return np.tile(tile, (n + 1, n + 1, 1))[:side, :side]


def flow(rng: np.random.Generator, side: int) -> Top:
    """Draw noise smeared along a flow: burls, combed plaster, brushed paint."""
    angle = noise(rng, side, rng.uniform(1.5, 5), 2, 0.4) * rng.uniform(0.3, 1.5) + rng.uniform(0, 6)
    length = rng.uniform(0.002, 0.012)
    right, down = np.cos(angle) * np.float32(length), np.sin(angle) * np.float32(length)
    field: Field = noise(rng, side, rng.uniform(25, 120), 2, 0.7)
    for step in (1, 2, 4):
        field = (field + bend(field, right * step, down * step)) / 2
    field = field / max(float(field.std()), 1e-3)
    return ramp(0.5 + rng.uniform(0.1, 0.35) * field, shades(rng, 2, 3))


def dabs(rng: np.random.Generator, side: int) -> Top:
    """Draw dabs of a sponge: one speckled print, stamped over and over."""
    picture = flat(side, colour(rng))
    size = int(side * rng.uniform(0.08, 0.25))
    print_ = np.clip(noise(rng, size, rng.uniform(4, 12), 3, 0.7) - rng.uniform(0, 1), 0, 1)
    y, x = np.mgrid[:size, :size] / size - 0.5
    print_ = (print_ * (np.hypot(x, y) < 0.48)).astype(np.float32)[..., None] * np.float32(rng.uniform(0.3, 1))
    colours = shades(rng, 1, 4)
    for _ in range(int(min(1.5 * (side / size) ** 2, 250))):
        row, column = rng.integers(-size // 2, side - size // 2, 2)
        rows, columns = slice(max(row, 0), min(row + size, side)), slice(max(column, 0), min(column + size, side))
        dab = np.rot90(print_, int(rng.integers(4)))
        dab = dab[rows.start - row : rows.stop - row, columns.start - column : columns.stop - column]
        picture[rows, columns] += (colours[rng.integers(len(colours))] - picture[rows, columns]) * dab
    return picture


TAUGHT = (dead_leaves, random_network, wallpaper, flow)
HELD_OUT = (dabs,)
