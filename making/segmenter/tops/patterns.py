"""Table tops with printed, laid or random patterns."""

import cv2
import numpy as np

from making.segmenter.paint import (
    FRACTION_BITS,
    Field,
    Top,
    blend,
    cloth,
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
    step,
    wet,
)
from making.segmenter.tops.stone import cells


def stripes(rng: np.random.Generator, side: int) -> Top:
    """Draw printed stripes, straight or wavy."""
    x, y = grid(side)
    wave = rng.uniform(0, 0.03) * np.sin(x * 2 * np.pi * rng.uniform(0.5, 6)) if rng.random() < 0.5 else 0
    field = ((y + wave) * rng.uniform(3, 30)) % 1
    sharp = step(np.abs(field - 0.5) - rng.uniform(0.05, 0.4), 0.06)
    return ramp(sharp if rng.random() < 0.7 else field, shades(rng, 2, 4))


def plain(rng: np.random.Generator, side: int) -> Top:
    """Draw a painted or laminated top of one colour."""
    return flat(side, colour(rng, saturation=(0, 0.7))) * (1 + 0.02 * rng.random() * noise(rng, side, 60, 2))[..., None]


def gradient(rng: np.random.Generator, side: int) -> Top:
    """Draw colours that run into one another."""
    x, y = grid(side)
    field = x + 0.3 * rng.normal() * y + 0.15 * rng.random() * noise(rng, side, 2, 2)
    return ramp((field - field.min()) / np.ptp(field), shades(rng))


def clouds(rng: np.random.Generator, side: int) -> Top:
    """Draw noise of several octaves in a few colours."""
    field = noise(
        rng, side, np.exp(rng.uniform(0.5, 4)), int(rng.integers(1, 6)), rng.uniform(0.4, 0.9), rng.uniform(0.5, 4)
    )
    return ramp(0.5 + rng.uniform(0.1, 0.4) * field, shades(rng))


def camouflage(rng: np.random.Generator, side: int) -> Top:
    """Draw blots with sharp edges, one over the other."""
    picture = flat(side, colour(rng))
    for shade in shades(rng):
        field = noise(rng, side, np.exp(rng.uniform(1, 3.5)), int(rng.integers(1, 4)), 0.5, rng.uniform(0.5, 3))
        picture = blend(picture, shade, step(field - rng.uniform(0, 1.2), 0.1))
    return picture


def squares(rng: np.random.Generator, side: int) -> Top:
    """Draw a chessboard, with or without seams."""
    x, y = grid(side)
    n, m = (rng.uniform(3, 30),) * 2 if rng.random() < 0.6 else rng.uniform(3, 30, 2)
    dark = ((np.floor(x * n) + np.floor(y * m)) % 2).astype(np.float32)
    return ramp(dark, shades(rng, 2, 2)) * (1 + 0.04 * noise(rng, side, 10, 4))[..., None]


def zigzag(rng: np.random.Generator, side: int) -> Top:
    """Draw chevrons or waves."""
    x, y = grid(side)
    n = rng.uniform(3, 15)
    wave = np.abs((x * n) % 1 - 0.5) * rng.uniform(0.5, 2) / n
    field = ((y + wave) * rng.uniform(4, 20)) % 1
    colours = shades(rng, 2, 4)
    return np.asarray(colours)[np.minimum((field * len(colours)).astype(int), len(colours) - 1)]


def motif(rng: np.random.Generator, radius: Field, angle: Field) -> Field:
    """Return a random ornament within radius 1: a disc, ring, star, flower, cross or diamond, from 0 to 1."""
    kind, points = rng.integers(6), float(rng.integers(3, 9))
    size = rng.uniform(0.4, 0.95)
    if kind == 0:
        outline = radius
    elif kind == 1:
        outline = np.abs(radius - 0.7 * size) + 0.7 * size
    elif kind == 2:
        outline = radius * (1 + 0.6 * np.abs(np.sin(angle * points / 2)))
    elif kind == 3:
        outline = radius / (0.6 + 0.4 * np.cos(angle * points))
    elif kind == 4:
        outline = np.minimum(np.abs(np.cos(angle)), np.abs(np.sin(angle))) * radius * 3 + 0.2 * radius
    else:
        outline = radius * (np.abs(np.cos(angle)) + np.abs(np.sin(angle)))
    return step(size - outline, 0.1)


def lattice(rng: np.random.Generator, side: int) -> Top:
    """Draw ornaments on a lattice, as on printed cloth or oilcloth."""
    x, y = grid(side)
    n = float(np.exp(rng.uniform(1.4, 3.5)))
    stagger = 0.5 * float(rng.integers(2))
    column = np.floor(x * n)
    u, v = (x * n) % 1 - 0.5, (y * n + stagger * (column % 2)) % 1 - 0.5
    picture = flat(side, cloth(rng))
    for _ in range(rng.integers(1, 4)):
        radius, angle = np.hypot(u, v) * 2 / rng.uniform(0.3, 1), np.arctan2(v, u) + rng.uniform(0, 6)
        picture = blend(picture, cloth(rng), motif(rng, radius, angle))
        u, v = (u + 0.5 + 0.5 * float(rng.integers(2))) % 1 - 0.5, (v + 0.5 + 0.5 * float(rng.integers(2))) % 1 - 0.5
    return picture


def scattered_motifs(rng: np.random.Generator, side: int) -> Top:
    """Draw ornaments strewn over a ground: petals, leaves, dots."""
    picture = sheet(cloth(rng), side) if rng.random() < 0.6 else wet(clouds(rng, side))
    colours = shades(rng, 1, 4)
    length = np.exp(rng.uniform(-4.5, -2.5)) * side
    kind = rng.integers(3)
    for _ in range(int(min(rng.uniform(0.1, 0.6) * (side / length) ** 2, 500))):
        centre, turn = rng.uniform(0, side, 2), rng.uniform(0, 180)
        axes = length * rng.uniform(0.3, 0.6, 2) * (1, [1, 0.4, 0.15][kind])
        shade = ink(colours[rng.integers(len(colours))])
        ellipse = points(centre).tolist(), points(axes).tolist(), turn, 0, 360
        cv2.ellipse(picture, *ellipse, shade, -1, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def strokes(rng: np.random.Generator, side: int) -> Top:
    """Draw rows of short strokes, as of brushes, tufts or writing."""
    picture = sheet(cloth(rng), side)
    colours = shades(rng, 1, 3)
    rows = int(rng.integers(8, 45))
    length, turn, disorder = rng.uniform(0.3, 2) / rows, rng.uniform(0, np.pi), rng.uniform(0, 0.6)
    thick = max(int(side / rows * rng.uniform(0.1, 0.4)), 1)
    for row in range(rows + 1):
        for place in np.arange(0, 1, max(length * rng.uniform(0.6, 1.5), 0.012)):
            centre = np.array([place, (row + rng.normal(0, disorder / 3)) / rows]) * side
            angle = turn + rng.normal(0, disorder)
            arm = np.array([np.cos(angle), np.sin(angle)]) * length * side / 2
            ends = points(centre + arm).tolist(), points(centre - arm).tolist()
            cv2.line(picture, *ends, ink(colours[rng.integers(len(colours))]), thick, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def crossing_lines(rng: np.random.Generator, side: int) -> Top:
    """Draw scratches or threads that cross at random."""
    picture = sheet(colour(rng), side) if rng.random() < 0.5 else wet(clouds(rng, side))
    colours = shades(rng, 1, 3)
    for _ in range(rng.integers(5, 90)):
        start, angle = rng.uniform(-0.1, 1.1, 2) * side, rng.uniform(0, 2 * np.pi)
        stop = start + np.array([np.cos(angle), np.sin(angle)]) * side * rng.exponential(0.5)
        ends, shade = (points(start).tolist(), points(stop).tolist()), ink(colours[rng.integers(len(colours))])
        cv2.line(picture, *ends, shade, int(rng.integers(1, 4)), cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def mosaic(rng: np.random.Generator, side: int) -> Top:
    """Draw a mosaic of irregular stones."""
    number, _, edge = cells(rng, side, int(np.exp(rng.uniform(4, 7.2))), rng.uniform(0.2, 1))
    picture = ramp(number, shades(rng, 2, 6)) * (1 + 0.04 * noise(rng, side, 40, 2))[..., None]
    return blend(picture, colour(rng, saturation=(0, 0.2)), 1 - step(edge - rng.uniform(0, 0.004), 0.004))


def square_tiles(rng: np.random.Generator, side: int) -> Top:
    """Draw square tiles with grout, each with its own shade or ornament."""
    x, y = grid(side)
    n = rng.uniform(4, 25)
    m = n * (1 + (rng.random() < 0.3))
    row = np.floor(y * m)
    across = x * n + 0.5 * float(rng.integers(2)) * (row % 2)
    number = rng.random((64, 64)).astype(np.float32)[row.astype(int) % 64, np.floor(across).astype(int) % 64]
    u, v = across % 1 - 0.5, (y * m) % 1 - 0.5
    base = colour(rng)
    picture = ramp(number, [base, near(rng, base, rng.uniform(0, 0.2))])
    if rng.random() < 0.5:
        picture = blend(picture, colour(rng), motif(rng, 2 * np.hypot(u, v), np.arctan2(v, u)))
    edge = np.minimum(0.5 - np.abs(u), 0.5 - np.abs(v)) / n
    return blend(picture, colour(rng, saturation=(0, 0.2)), 1 - step(edge - rng.uniform(0.0005, 0.003), 0.003))


def hexagons(rng: np.random.Generator, side: int) -> Top:
    """Draw hexagonal tiles."""
    x, y = grid(side)
    n = rng.uniform(4, 22)
    x, y = x * n, y * n / np.float32(np.sqrt(3))
    first = np.stack([np.round(x), np.round(y)])
    second = np.stack([np.floor(x) + 0.5, np.floor(y) + 0.5])
    d_first, d_second = (np.hypot(x - c[0], (y - c[1]) * float(np.sqrt(3))) for c in (first, second))
    centre = np.where(d_first < d_second, first, second) * 2
    number = rng.random(4096).astype(np.float32)[(centre[0].astype(int) * 67 + centre[1].astype(int) * 29) % 4096]
    picture = ramp(number, shades(rng, 2, 5))
    return blend(picture, colour(rng, saturation=(0, 0.3)), 1 - step(np.abs(d_first - d_second) / n - 0.002, 0.004))


def scales(rng: np.random.Generator, side: int) -> Top:
    """Draw overlapping scales or fans."""
    x, y = grid(side)
    n = rng.uniform(4, 20)
    picture, covered = np.zeros((side, side), np.float32), np.zeros((side, side), bool)
    for layer in range(3):
        row = np.floor(y * n * 2) + layer
        u = (x * n + 0.5 * (row % 2)) % 1 - 0.5
        distance = np.hypot(u, (y * n * 2 - row - 0.0) / 2)
        inside = (distance < 0.5) & ~covered
        picture = np.where(inside, distance * 2, picture)
        covered |= inside
    rings = (picture * rng.integers(1, 6)) % 1
    return ramp(rings if rng.random() < 0.6 else picture, shades(rng, 2, 4))


def truchet(rng: np.random.Generator, side: int) -> Top:
    """Draw a maze of arcs: square tiles with two quarter circles each, turned at random."""
    x, y = grid(side)
    n = rng.uniform(4, 20)
    flip = rng.random((64, 64))[np.floor(y * n).astype(int), np.floor(x * n).astype(int)] < 0.5
    u, v = (x * n) % 1, (y * n) % 1
    u = np.where(flip, 1 - u, u)
    radius = np.minimum(np.hypot(u, v), np.hypot(1 - u, 1 - v))
    arc = 1 - step(np.abs(radius - 0.5) - rng.uniform(0.05, 0.25), 0.05)
    return ramp(arc, shades(rng, 2, 2))


def polygons(rng: np.random.Generator, side: int) -> Top:
    """Draw large polygons over one another, some translucent."""
    picture = sheet(colour(rng), side)
    for _ in range(rng.integers(5, 40)):
        corners = rng.uniform(0, side, 2) + rng.normal(0, side * rng.uniform(0.05, 0.35), (rng.integers(3, 6), 2))
        layer = cv2.fillPoly(picture.copy(), [points(corners)], ink(colour(rng)), cv2.LINE_AA, FRACTION_BITS)
        share = rng.uniform(0.2, 1)
        picture = cv2.addWeighted(layer, share, picture, 1 - share, 0)
    return dried(picture)


def rays(rng: np.random.Generator, side: int) -> Top:
    """Draw rings or rays about a point, as of turned wood, a sunburst or a woven mat."""
    x, y = grid(side)
    centre = rng.uniform(-0.2, 1.2, 2)
    radius, angle = np.hypot(x - centre[0], y - centre[1]), np.arctan2(y - centre[1], x - centre[0])
    kind = rng.integers(3)
    field = [radius * rng.uniform(4, 30), angle / 2 / np.pi * rng.integers(6, 40), None][kind] if kind < 2 else None
    if field is None:
        field = radius * rng.uniform(3, 15) + angle / 2 / np.pi * rng.integers(1, 6)
    wave = 0.5 + 0.5 * np.sin(2 * np.pi * field)
    wave = wave if rng.random() < 0.5 else step(wave - 0.45, 0.1)
    return ramp(wave.astype(np.float32), shades(rng, 2, 4)) * (1 + 0.04 * noise(rng, side, 30, 3))[..., None]


def waves(rng: np.random.Generator, side: int) -> Top:
    """Draw plane waves that cross, as in quasi-crystals and guilloche."""
    x, y = grid(side)
    field = np.zeros((side, side), np.float32)
    for turn in np.arange(count := int(rng.integers(2, 8))) * np.pi / count + rng.normal(0, 0.05, count):
        field += np.sin(2 * np.pi * rng.uniform(4, 25) * (x * np.cos(turn) + y * np.sin(turn)) + rng.uniform(0, 6))
    field = field / np.sqrt(count)
    return ramp(step(field, 0.2) if rng.random() < 0.4 else 0.5 + 0.3 * field, shades(rng, 2, 4))


def labyrinth(rng: np.random.Generator, side: int) -> Top:
    """Draw the spots and worms of noise of one wavelength, as on shells and leather."""
    wave = np.exp(rng.uniform(0.7, 2.2))
    field = rng.standard_normal((side, side), np.float32)
    field = cv2.GaussianBlur(field, (0, 0), wave, borderType=cv2.BORDER_REFLECT) - cv2.GaussianBlur(
        field, (0, 0), wave * 1.6, borderType=cv2.BORDER_REFLECT
    )
    field /= field.std()
    return ramp(step(field - rng.uniform(-0.8, 0.8), rng.uniform(0.1, 1)), shades(rng, 2, 3))


def leather(rng: np.random.Generator, side: int) -> Top:
    """Draw leather or felt: a fine relief, lit from one side."""
    height = noise(rng, side, rng.uniform(20, 90), 3, 0.7)
    light = cv2.Sobel(height, -1, 1, 0) * rng.uniform(0.01, 0.06)
    base = colour(rng, value=(0.1, 0.7))
    return base * np.clip(1 + light + 0.08 * noise(rng, side, 3, 3), 0.3, 1.8)[..., None]


def brushed_metal(rng: np.random.Generator, side: int) -> Top:
    """Draw brushed steel or brass: fine streaks and broad reflections across them."""
    base = colour(rng, (0.05, 0.65), (0, 0.3), (0.4, 0.9))
    _, y = grid(side)
    streaks = noise(rng, side, side / 2, stretch=60) * rng.uniform(0.02, 0.1)
    glow = 0.3 * rng.random() * np.sin(2 * np.pi * (y * rng.uniform(0.5, 2.5) + rng.random()))
    return base * (1 + streaks + glow)[..., None]


def cork(rng: np.random.Generator, side: int) -> Top:
    """Draw cork: crumbs of one brown with dark flecks."""
    number, _, _ = cells(rng, side, int(rng.uniform(900, 3000)))
    base = colour(rng, (0.05, 0.11), (0.3, 0.65), (0.45, 0.85))
    picture = base * (0.8 + 0.35 * number + 0.06 * noise(rng, side, 100))[..., None]
    return blend(picture, base * 0.35, step(noise(rng, side, 70) - 1.6, 0.3) * 0.9)


TAUGHT = (
    *(plain, gradient, clouds, camouflage, squares, stripes, zigzag, lattice, scattered_motifs, strokes),
    *(crossing_lines, mosaic, square_tiles, scales, polygons, rays, waves, labyrinth, leather),
)
HELD_OUT = (hexagons, truchet, brushed_metal, cork)
