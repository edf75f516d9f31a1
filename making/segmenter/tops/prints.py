"""Draw table tops with printed, laid or random patterns and pictures."""

import cv2
import numpy as np

from making.segmenter.paint import (
    FRACTION_BITS,
    Field,
    Top,
    bend,
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
from making.segmenter.tops.materials import cells


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


def flowers(rng: np.random.Generator, side: int) -> Top:
    """Draw sprigs: blossoms of petals about a heart, with stalks and leaves."""
    picture = sheet(cloth(rng), side)
    petals, hearts, leaves = shades(rng, 1, 3), colour(rng), colour(rng, (0.2, 0.5), (0.1, 0.7), (0.15, 0.8))
    size = side * rng.uniform(0.015, 0.06)
    for centre in rng.uniform(0, side, (int(min(rng.uniform(0.15, 0.5) * (side / size / 2) ** 2, 90)), 2)):
        turn, count, radius = rng.uniform(0, 360), int(rng.integers(4, 9)), size * rng.uniform(0.6, 1.2)
        bow = centre + rng.normal(0, 2, (4, 2)).cumsum(0) * radius / 2
        cv2.polylines(picture, [points(bow)], False, ink(leaves), 1, cv2.LINE_AA, FRACTION_BITS)
        for end in bow[2:]:
            leaf = points(end).tolist(), points([radius * 0.5, radius * 0.2]).tolist(), turn, 0, 360
            cv2.ellipse(picture, *leaf, ink(leaves), -1, cv2.LINE_AA, FRACTION_BITS)
        shade = ink(petals[rng.integers(len(petals))])
        for k in range(count):
            angle = turn + 360 * k / count
            away = centre + radius * 0.55 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
            petal = points(away).tolist(), points([radius * 0.5, radius * 0.25]).tolist(), angle, 0, 360
            cv2.ellipse(picture, *petal, shade, -1, cv2.LINE_AA, FRACTION_BITS)
        cv2.circle(picture, points(centre).tolist(), int(radius * 4), ink(hearts), -1, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def writing(rng: np.random.Generator, side: int) -> Top:
    """Draw lines of letters in one or two sizes."""
    picture = sheet(cloth(rng), side)
    letters = np.array(list("abcdefghiklmnoprstuvwxyzABCDEMRST   "))
    scale = side / 240 * rng.uniform(0.25, 1.2)
    for base in np.arange(0, side + 20, 24 * scale):
        text = "".join(rng.choice(letters, 60))
        shade = ink(colour(rng, value=(0.02, 0.5)))
        origin = int(rng.uniform(-30, 5)), int(base)
        cv2.putText(picture, text, origin, int(rng.integers(0, 7)), scale, shade, 1 + (scale > 0.7), cv2.LINE_AA)
    return dried(picture)


def contours(rng: np.random.Generator, side: int) -> Top:
    """Draw a map: coloured heights with contour lines and roads."""
    height = noise(rng, side, rng.uniform(1.5, 5), 4, 0.45)
    picture = ramp(0.5 + 0.25 * height, shades(rng, 2, 5))
    lines = 1 - step(np.abs((height * rng.uniform(2, 8)) % 1 - 0.5) - 0.03, 0.06)
    picture = blend(picture, colour(rng, value=(0.05, 0.6)), lines * rng.uniform(0.2, 1))
    roads = np.exp(-((noise(rng, side, 3, 2) / 0.04) ** 2))
    return blend(picture, colour(rng), roads * float(rng.integers(0, 2)))


def halftone(rng: np.random.Generator, side: int) -> Top:
    """Draw a picture printed in dots whose size follows its darkness."""
    x, y = grid(side)
    n, turn = rng.uniform(25, 80), rng.uniform(0, np.pi)
    u, v = (x * np.cos(turn) + y * np.sin(turn)) * n, (y * np.cos(turn) - x * np.sin(turn)) * n
    screen = np.cos(2 * np.pi * u) + np.cos(2 * np.pi * v)
    tone = noise(rng, side, rng.uniform(1.5, 5), 2) * rng.uniform(0.3, 1.2)
    return ramp(step(screen + tone, 0.4), shades(rng, 2, 2))


def patchwork(rng: np.random.Generator, side: int) -> Top:
    """Draw patches of printed cloth sewn together, each with its own print."""
    n = int(rng.integers(4, 11))
    x, y = grid(side)
    column, row = np.floor(x * n).astype(int), np.floor(y * n).astype(int)
    kinds = rng.integers(0, 4, (n, n))[row, column]
    ground, print_ = rng.random((n, n, 3)).astype(np.float32)[row, column], rng.random((n, n, 3)).astype(np.float32)
    k = rng.uniform(3, 9) * n
    u, v = x * k % 1 - 0.5, y * k % 1 - 0.5
    share = np.select([kinds == 1, kinds == 2, kinds == 3], [np.hypot(u, v) < 0.3, u > 0, (u > 0) ^ (v > 0)], False)
    if rng.random() < 0.4:
        share &= (x * n % 1) > (y * n % 1)
    picture = blend(ground, print_[row, column], share.astype(np.float32))
    tone = cloth(rng)
    return (picture + (tone - picture) * np.float32(rng.uniform(0, 0.6))).astype(np.float32)


def houndstooth(rng: np.random.Generator, side: int) -> Top:
    """Draw houndstooth: broken checks of two colours."""
    x, y = grid(side)
    n = rng.uniform(6, 30)
    u, v = x * n % 1, y * n % 1
    stripe = ((u + v) * 2) % 1 < 0.5
    dark = np.where((u < 0.5) & (v < 0.5), True, np.where((u >= 0.5) & (v >= 0.5), False, stripe))
    return ramp(dark.astype(np.float32), [cloth(rng), cloth(rng)])


def argyle(rng: np.random.Generator, side: int) -> Top:
    """Draw diamonds with thin lines that cross them."""
    x, y = grid(side)
    n, slim = rng.uniform(3, 12), rng.uniform(0.5, 0.9)
    u, v = x * n + y * n * slim, x * n - y * n * slim
    colours = shades(rng, 3, 4)
    number = ((np.floor(u) + np.floor(v)) % 2 + (np.floor(u) % 2) * 0.5) / 1.5
    picture = ramp(number, colours)
    line = np.minimum(np.abs(u % 1 - 0.5), np.abs(v % 1 - 0.5))
    return blend(picture, colour(rng), 1 - step(line - 0.015, 0.03))


def ruled(rng: np.random.Generator, side: int) -> Top:
    """Draw a cutting mat or squared paper: fine lines and bold ones."""
    x, y = grid(side)
    n = rng.uniform(8, 50)
    every = int(rng.integers(2, 11))
    fine = np.minimum(np.abs(x * n % 1 - 0.5), np.abs(y * n % 1 - 0.5)) / n
    bold = np.minimum(np.abs(x * n / every % 1 - 0.5), np.abs(y * n / every % 1 - 0.5)) * every / n
    base, line = colour(rng), colour(rng)
    picture = blend(flat(side, base), line, (1 - step(fine, 0.003)) * rng.uniform(0.1, 0.6))
    return blend(picture, line, 1 - step(bold - 0.001, 0.004))


def bubbles(rng: np.random.Generator, side: int) -> Top:
    """Draw crowded translucent rings and discs of many sizes."""
    picture = sheet(colour(rng), side)
    colours = shades(rng, 2, 5)
    for _ in range(rng.integers(25, 90)):
        layer, centre = picture.copy(), points(rng.uniform(0, side, 2)).tolist()
        radius = int(points(side * rng.gamma(2, 0.018)))
        thick = -1 if rng.random() < 0.6 else int(rng.integers(1, 5))
        cv2.circle(layer, centre, radius, ink(colours[rng.integers(len(colours))]), thick, cv2.LINE_AA, FRACTION_BITS)
        picture = cv2.addWeighted(layer, 0.6, picture, 0.4, 0)
    return dried(picture)


def brush(rng: np.random.Generator, side: int) -> Top:
    """Draw broad strokes of a brush, each with streaks of its own."""
    picture = sheet(colour(rng), side)
    for _ in range(rng.integers(15, 70)):
        start, turn = rng.uniform(0, side, 2), rng.uniform(0, 2 * np.pi)
        along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
        base, length, width = colour(rng), side * rng.uniform(0.05, 0.5), side * rng.uniform(0.01, 0.06)
        for offset in np.linspace(-width, width, 6):
            first = start + across * offset + along * rng.normal(0, width)
            last = first + along * length * rng.uniform(0.8, 1.1)
            shade, thick = ink(near(rng, base, 0.08)), max(int(width / 2.5), 1)
            cv2.line(picture, points(first).tolist(), points(last).tolist(), shade, thick, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def spirals(rng: np.random.Generator, side: int) -> Top:
    """Draw seeds in the spirals of a sunflower, growing outwards."""
    picture = sheet(colour(rng), side)
    colours = shades(rng, 1, 3)
    centre, gap = rng.uniform(0.2, 0.8, 2) * side, side * rng.uniform(0.012, 0.03)
    for k in range(int(min((side / gap) ** 2 * 0.5, 800))):
        radius, angle = gap * np.sqrt(k), k * 2.399963
        place = points(centre + radius * np.array([np.cos(angle), np.sin(angle)])).tolist()
        shade = ink(colours[k % len(colours)])
        cv2.circle(picture, place, int(points(gap * 0.45)), shade, -1, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def newspaper(rng: np.random.Generator, side: int) -> Top:
    """Draw printed pages: columns of words, headlines and grey pictures."""
    paper, black = colour(rng, (0.08, 0.16), (0, 0.2), (0.7, 0.97)), colour(rng, saturation=(0, 0.3), value=(0.02, 0.3))
    share = np.zeros((side, side), np.float32)
    line, gutter = max(int(side * rng.uniform(0.008, 0.02)), 3), int(side * 0.02)
    width = int(side / rng.integers(3, 8))
    for left in range(0, side, width):
        top = 0
        while top < side:
            kind = rng.random()
            tall = int(side * rng.uniform(0.05, 0.2)) if kind < 0.1 else 2 * line if kind < 0.2 else line
            rows, columns = slice(top, top + int(tall * 0.65)), slice(left, left + width - gutter)
            if kind < 0.1:
                share[rows, columns] = rng.uniform(0.2, 0.8)
            else:
                words = cv2.resize((rng.random((1, width // 3)) < 0.75).astype(np.float32), (width - gutter, 1))
                share[rows, columns] = words[:, : share[rows, columns].shape[1]] * rng.uniform(0.5, 0.9)
            top += tall
    return blend(flat(side, paper), black, share)


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
    for reach in (1, 2, 4):
        field = (field + bend(field, right * reach, down * reach)) / 2
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


GROUPS = (  # the taught and the held-out families of patterns, of printed pictures and of random pictures
    (
        (
            plain, gradient, clouds, camouflage, squares, stripes, zigzag, lattice, scattered_motifs, strokes,
            crossing_lines, mosaic, square_tiles, scales, polygons, rays, waves, labyrinth, leather,
        ),
        (hexagons, truchet, brushed_metal, cork),
    ),
    (
        (flowers, writing, contours, patchwork, argyle, ruled, bubbles, brush),
        (newspaper, houndstooth, halftone, spirals),
    ),
    ((dead_leaves, random_network, wallpaper, flow), (dabs,)),
)  # fmt: skip
