"""Draw table tops of many families: wood, stone, cloth, tiles, patterns, prints and random pictures.

Boards and threads run along x. Whole families are held out of training, to judge the segmenter on kinds it never saw.
"""

import cv2
import numpy as np

from making.segmenter.paint import (
    FRACTION_BITS,
    Colour,
    Field,
    Rng,
    Top,
    bend,
    blend,
    cloth,
    colour,
    dried,
    grid,
    ink,
    near,
    noise,
    points,
    ramp,
    shades,
    sheet,
    step,
    stone,
    wet,
    wood,
)


def grain(rng: Rng, side: int) -> Field:
    """Return the streaks of straight grain, from 0 to 1: fine fibres over broad bands."""
    fibres = noise(rng, side, rng.uniform(60, 160), 2, 0.7, stretch=rng.uniform(12, 40))
    bands = noise(rng, side, rng.uniform(5, 25), 2, 0.6, stretch=rng.uniform(4, 15))
    return np.clip(0.5 + rng.uniform(0.05, 0.25) * fibres + rng.uniform(0.05, 0.3) * bands, 0, 1)


def wood_shades(rng: Rng) -> list[Colour]:
    """Draw the dark and the light colour of one wood."""
    light = wood(rng)
    return [light * rng.uniform(0.45, 0.9) * np.array([1, 0.96, 0.92], np.float32), light]


def planks(rng: Rng, side: int) -> Top:
    """Draw planks side by side, each with a length, shade and grain of its own."""
    (x, y), rows = grid(side), rng.uniform(4, 16)
    row = np.floor(y * rows).astype(int)
    length = rng.uniform(0.5, 3, row.max() + 1)[row].astype(np.float32)
    along = x / length + rng.random(row.max() + 1)[row].astype(np.float32)
    number = rng.random(4096).astype(np.float32)[(row * 97 + np.floor(along).astype(int) * 31) % 4096]
    edge = np.minimum((0.5 - np.abs((y * rows) % 1 - 0.5)) / rows, (0.5 - np.abs(along % 1 - 0.5)) * length)
    shifted = (np.arange(side)[:, None] + (number * side).astype(int)) % side
    field = np.take_along_axis(grain(rng, side), shifted, 0)
    picture = ramp(field, wood_shades(rng)) * (1 + rng.uniform(0.1, 0.6) * (number - 0.5))[..., None]
    gap = 1 - step(edge - rng.uniform(0, 0.002), 0.004)
    return blend(picture, picture * rng.uniform(0.15, 0.8), gap * rng.uniform(0.4, 1))


def marble(rng: Rng, side: int) -> Top:
    """Draw marble: thin veins where warped noise crosses zero, over clouds."""
    base, vein = stone(rng), stone(rng)
    picture = ramp(0.5 + 0.2 * noise(rng, side, rng.uniform(2, 6), 4, 0.6), [near(rng, base, 0.1), base])
    for _ in range(rng.integers(1, 5)):
        crossing = np.abs(noise(rng, side, rng.uniform(1.5, 7), 5, rng.uniform(0.4, 0.65), rng.uniform(0.5, 2)))
        share = np.exp(-crossing / rng.uniform(0.01, 0.15)) * step(noise(rng, side, 3) + 1, 1.5)
        picture = blend(picture, near(rng, vein, 0.1), share * rng.uniform(0.2, 1))
    return picture


def granite(rng: Rng, side: int) -> Top:
    """Draw granite: grains of two to four minerals over a base."""
    picture = base = stone(rng)
    for mineral in [near(rng, base, rng.uniform(0.05, 0.4)) for _ in range(rng.integers(2, 5))]:
        speckles = noise(rng, side, rng.uniform(60, 240), 1) + 0.5 * noise(rng, side, rng.uniform(30, 120))
        picture = blend(picture, mineral, step(speckles - rng.uniform(0.2, 1.8), 0.3) * rng.uniform(0.3, 1))
    return picture * (1 + rng.uniform(0, 0.15) * noise(rng, side, 3, 3))[..., None]


def cathedral_grain(rng: Rng, side: int) -> Top:
    """Draw a board cut through its rings: nested arches and knots."""
    x, y = grid(side)
    centre = rng.uniform(-0.3, 1.3, 2)
    depth = np.hypot((y - centre[1]) * rng.uniform(1.5, 4), (x - centre[0]) * rng.uniform(0.2, 0.8))
    for knot in rng.uniform(0, 1, (rng.integers(0, 5), 2)):
        nearness = np.exp(-(((x - knot[0]) / 0.08) ** 2 + ((y - knot[1]) / 0.04) ** 2))
        depth = depth + rng.uniform(0.1, 0.4) * nearness
    rings = ((depth + 0.02 * noise(rng, side, 6, 3, stretch=5)) * rng.uniform(8, 40)) % 1
    field = np.clip(rings ** rng.uniform(0.7, 3) + 0.15 * (grain(rng, side) - 0.5), 0, 1)
    return ramp(field, wood_shades(rng)[::-1])


def bamboo(rng: Rng, side: int) -> Top:
    """Draw narrow strips of bamboo with their nodes."""
    x, y = grid(side)
    strips = rng.uniform(25, 60)
    row = np.floor(y * strips).astype(int)
    shift = rng.random(row.max() + 1)[row].astype(np.float32)
    node = np.abs((x * rng.uniform(2, 6) + shift) % 1 - 0.5)
    light = colour(rng, (0.1, 0.14), (0.25, 0.55), (0.6, 0.95))
    picture = ramp(np.clip(shift * 0.5 + 0.5 * grain(rng, side), 0, 1), [light * 0.8, light])
    seam = step(np.abs((y * strips) % 1 - 0.5) - 0.42, 0.05)
    return picture * (1 - 0.3 * np.exp(-((node / 0.012) ** 2)) - 0.2 * seam)[..., None]


def herringbone(rng: Rng, side: int) -> Top:
    """Draw a herringbone parquet."""
    (x, y), ratio = grid(side, rng.uniform(12, 40)), int(rng.integers(3, 6))
    column, row = np.floor(x).astype(int), np.floor(y).astype(int)
    phase = (column - row) % (2 * ratio)
    lies = phase < ratio
    start = np.where(lies, column - phase, row - (2 * ratio - 1 - phase))
    number = rng.random(8192).astype(np.float32)[(start * 131 + np.where(lies, row, column) * 71 + lies * 17) % 8192]
    across = np.where(lies, y % 1, x % 1)
    along = np.where(lies, phase + x % 1, (2 * ratio - 1 - phase) + y % 1)
    edge = np.minimum(np.minimum(across, 1 - across), np.minimum(along, ratio - along))
    field = grain(rng, side)
    streaks = np.where(lies, field, field.T)
    picture = ramp(np.clip(0.6 * streaks + 0.4 * number, 0, 1), wood_shades(rng))
    return blend(picture, picture * 0.4, (1 - step(edge, 0.15)).astype(np.float32) * rng.uniform(0.2, 0.9))


def slate(rng: Rng, side: int) -> Top:
    """Draw slate: a split surface with steps that catch the light."""
    height = noise(rng, side, rng.uniform(2, 6), 5, 0.55, rng.uniform(1, 4))
    layers = np.floor(height * rng.uniform(1, 4)) + 0.3 * height
    light = cv2.Sobel(cv2.GaussianBlur(layers, (0, 0), 0.8), -1, 1, 0, ksize=3)
    base = colour(rng, (0.45, 0.75), (0, 0.25), (0.1, 0.5))
    return base * np.clip(1 + rng.uniform(0.05, 0.2) * light + 0.05 * height, 0.3, 2)[..., None]


def agate(rng: Rng, side: int) -> Top:
    """Draw agate or onyx: many bands that follow one another."""
    height = noise(rng, side, rng.uniform(1.5, 4), 3, 0.4)
    bands = 0.5 + 0.5 * np.sin(height * rng.uniform(6, 30) + 2 * np.sin(height * rng.uniform(2, 9)))
    colours = [colour(rng, saturation=(0, 0.7)) for _ in range(rng.integers(2, 5))]
    return ramp(bands, colours) * (1 + 0.05 * noise(rng, side, 20, 3))[..., None]


def cells(rng: Rng, side: int, count: int) -> tuple[Field, Field, Field]:
    """Return Voronoi cells: a random number for each cell, the distance to its point and the distance from its edge.

    Distances are shares of the side. The points lie on a grid, shifted by up to half its step.
    """
    n = max(int(np.sqrt(count)), 2)
    places = np.stack(np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5), -1) + rng.uniform(-0.5, 0.5, (n, n, 2))
    column, row = np.clip(places * side / n, 0, side - 1).astype(int).reshape(-1, 2).T
    free = np.ones((side, side), np.uint8)
    free[row, column] = 0
    to_point, owner = cv2.distanceTransformWithLabels(free, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    owner = np.asarray(owner, np.int64)
    inside = np.ones((side, side), np.uint8)
    inside[1:] &= owner[1:] == owner[:-1]
    inside[:, 1:] &= owner[:, 1:] == owner[:, :-1]
    number = rng.random(int(owner.max()) + 1).astype(np.float32)[owner]
    return number, to_point / side, cv2.distanceTransform(inside, cv2.DIST_L2, 3) / side


def terrazzo(rng: Rng, side: int) -> Top:
    """Draw terrazzo: chips of several stones in a cement."""
    base = stone(rng)
    picture = wet(base * (1 + 0.03 * noise(rng, side, 80, 2))[..., None])
    chips = [colour(rng, saturation=(0, 0.6)) for _ in range(rng.integers(2, 6))]
    length = rng.uniform(0.006, 0.03)
    for _ in range(int(min(0.35 / length**2, 900))):
        centre, spread = rng.uniform(0, side, 2), length * side * rng.uniform(0.3, 0.8)
        corners = centre + rng.normal(0, spread, (rng.integers(4, 7), 2))
        shade = ink(chips[rng.integers(len(chips))])
        cv2.fillConvexPoly(picture, cv2.convexHull(points(corners)), shade, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def cracked(rng: Rng, side: int) -> Top:
    """Draw a cracked glaze, mud or leather: cells with dark or light seams."""
    number, _, edge = cells(rng, side, int(np.exp(rng.uniform(3.5, 7))))
    base = colour(rng)
    picture = base * (1 + rng.uniform(0, 0.4) * (number - 0.5) + 0.06 * noise(rng, side, 20, 3))[..., None]
    seam = 1 - step(edge - rng.uniform(0, 0.003), rng.uniform(0.003, 0.012))
    shade = picture * 0.4 if rng.random() < 0.7 else np.float32(1) - 0.3 * picture
    return blend(picture, shade, seam * rng.uniform(0.3, 1))


def pebbles(rng: Rng, side: int) -> Top:
    """Draw rounded pebbles in a mortar."""
    number, middle, edge = cells(rng, side, int(np.exp(rng.uniform(4.5, 7))))
    light = 1.1 - middle / max(float(middle.max()), 1e-3) * 0.5
    picture = ramp(number, [stone(rng) for _ in range(4)]) * light[..., None]
    return blend(stone(rng), picture, step(edge - 0.004, 0.006))


def finished(rng: Rng, picture: Top) -> Top:
    """Return a woven picture as a cloth on a table: threads, then folds or creases or both."""
    side, strength = len(picture), np.float32(rng.uniform(0, 0.06))
    warp, weft = noise(rng, side, 120, stretch=20), noise(rng, side, 120, stretch=20).T
    picture = picture * (1 + strength * (warp + weft))[..., None]
    chance = rng.random()
    if chance < 0.55:  # it lies unevenly: its pattern is bent and its folds are shaded
        height = noise(rng, side, rng.uniform(1.2, 4), 2, 0.4, rng.uniform(1, 3))
        slope_x, slope_y = (cv2.Sobel(height, -1, *along, scale=side / 900) for along in ((1, 0), (0, 1)))
        strength = rng.uniform(0, 1) ** 2
        bent = bend(picture, slope_x * np.float32(0.02 * strength), slope_y * np.float32(0.02 * strength))
        shade = 1 + np.float32(0.12 * strength) * (slope_x + rng.uniform(-1, 1) * slope_y)
        picture = bent * np.clip(shade, 0.4, 1.5)[..., None]
    if 0.4 < chance < 0.75:  # creases of having been folded, lit from one side
        shade = np.ones((side, side), np.float32)
        for along in grid(side):
            for place in ((np.arange(rng.integers(0, 4)) + rng.random()) / 3).tolist():
                away = (along - place) / rng.uniform(0.005, 0.03)
                shade = shade + rng.uniform(-0.25, 0.25) * away * np.exp(-(away**2))
        picture = picture * shade[..., None]
    return picture


def plain_cloth(rng: Rng, side: int) -> Top:
    """Draw a cloth of one colour."""
    return finished(rng, np.full((side, side, 3), cloth(rng), np.float32))


def crumpled(rng: Rng, side: int) -> Top:
    """Draw a crumpled cloth or paper: facets with sharp creases."""
    height = np.sum([np.abs(noise(rng, side, rng.uniform(2, 8), 2, 0.4)) for _ in range(rng.integers(3, 7))], 0)
    right, down = (cv2.Sobel(height, -1, *along, scale=side / 900) for along in ((1, 0), (0, 1)))
    light = right + rng.uniform(-1, 1) * down
    return cloth(rng) * np.clip(1 + rng.uniform(0.02, 0.12) * light, 0.3, 1.6)[..., None]


def band_shares(rng: Rng, side: int) -> tuple[Field, Field]:
    """Return one sequence of stripes along x and along y, as each stripe's random number from 0 to 1."""
    widths = rng.uniform(0.1, 1, rng.integers(2, 9)) ** 2 + 0.02
    ends = np.cumsum(widths) / widths.sum()
    numbers = rng.random(len(ends)).astype(np.float32)
    x, y = grid(side, rng.uniform(2, 14))
    rows, columns = (numbers[np.minimum(np.searchsorted(ends, along % 1), len(ends) - 1)] for along in (y, x))
    return rows, columns


def striped_cloth(rng: Rng, side: int) -> Top:
    """Draw a striped cloth."""
    stripes, _ = band_shares(rng, side)
    return finished(rng, ramp(stripes, [cloth(rng) for _ in range(rng.integers(2, 4))]))


def gingham(rng: Rng, side: int) -> Top:
    """Draw a checked cloth: two colours and their mixture where the bands cross."""
    x, y = grid(side, rng.uniform(5, 45))
    share = ((x % 1 < 0.5).astype(np.float32) + (y % 1 < 0.5)) / 2
    base = cloth(rng)
    return finished(rng, ramp(share, [base, near(rng, base, 0.25) if rng.random() < 0.3 else cloth(rng)]))


def tartan(rng: Rng, side: int) -> Top:
    """Draw a tartan: one sequence of stripes, woven both ways with a twill."""
    rows, columns = band_shares(rng, side)
    shades = [cloth(rng) for _ in range(rng.integers(3, 6))]
    x, y = grid(side)
    twill = 0.5 + 0.5 * np.sin((x + y) * 2 * np.pi * rng.uniform(40, 100)) * rng.uniform(0, 1)
    return finished(rng, blend(ramp(rows, shades), ramp(columns, shades), twill.astype(np.float32)))


def damask(rng: Rng, side: int) -> Top:
    """Draw damask: mirrored ornaments, told from their ground by the gloss of the threads alone."""
    n = int(rng.integers(2, 9))
    tile = max(side // n, 16)
    quarter = noise(rng, max(tile // 2, 8), rng.uniform(2, 5), 2, 0.5)
    half = np.hstack([quarter, quarter[:, ::-1]])
    motif = np.vstack([half, half[::-1]]) if rng.random() < 0.5 else np.vstack([half, np.roll(half, len(quarter), 1)])
    field = cv2.resize(np.tile(motif, (n + 2, n + 2))[:side, :side], (side, side))
    base = cloth(rng)
    share = step(field - rng.uniform(-0.3, 0.5), 0.15)
    return finished(rng, ramp(share, [base, near(rng, base, rng.uniform(0.03, 0.2))]))


def knit(rng: Rng, side: int) -> Top:
    """Draw knitting: columns of V-shaped stitches."""
    x, y = grid(side, rng.uniform(15, 60))
    u = np.abs(x % 1 - 0.5)
    v = (y * rng.uniform(0.8, 1.3) + u * rng.uniform(0.8, 2)) % 1
    stitch = np.sin(np.pi * v) * (1 - (2 * u - 0.5) ** 2)
    base, rows = cloth(rng), np.floor(y) % rng.integers(4, 20) < rng.integers(0, 6)
    picture = np.where(rows[..., None], cloth(rng), base)
    return finished(rng, (picture * (0.45 + 0.55 * stitch)[..., None]).astype(np.float32))


def lace(rng: Rng, side: int) -> Top:
    """Draw lace over a table: threads around holes, in rosettes."""
    x, y = grid(side)
    n = rng.uniform(4, 14)
    u, v = (x * n) % 1 - 0.5, (y * n + 0.5 * (np.floor(x * n) % 2)) % 1 - 0.5
    radius, angle = np.hypot(u, v), np.arctan2(v, u)
    petals = np.cos(angle * float(rng.integers(5, 12))) * rng.uniform(0.2, 0.8)
    rosette = np.sin(radius * 2 * np.pi * rng.uniform(3, 6) + petals * 2)
    net = np.maximum(np.sin(x * 2 * np.pi * n * 5), np.sin(y * 2 * np.pi * n * 5))
    thread = np.where(radius < 0.42, rosette, net)
    under = colour(rng) * (1 + 0.05 * noise(rng, side, 20, 3, stretch=8))[..., None]
    over = colour(rng, saturation=(0, 0.2), value=(0.7, 1))
    return blend(under, over, step(thread + rng.uniform(-0.2, 0.4), 0.4) * 0.9)


def basket(rng: Rng, side: int) -> Top:
    """Draw a basket weave: pairs or triples of canes, over and under."""
    (x, y), canes = grid(side, rng.uniform(8, 30)), int(rng.integers(2, 5))
    lies = (np.floor(x) + np.floor(y)) % 2 > 0
    across, along = np.where(lies, y % 1, x % 1), np.where(lies, x % 1, y % 1)
    round_cane = np.abs(np.sin(np.pi * across * canes)) ** rng.uniform(0.3, 1)
    light = (0.4 + 0.6 * round_cane) * (0.6 + 0.4 * np.sin(np.pi * along))
    base = wood(rng) if rng.random() < 0.7 else cloth(rng)
    picture = ramp(np.clip(0.5 + 0.15 * noise(rng, side, 60, 2), 0, 1), [near(rng, base, 0.1), base])
    return picture * light[..., None]


def bricks(rng: Rng, side: int) -> Top:
    """Draw bricks or pavers, each weathered on its own."""
    x, y = grid(side, rng.uniform(6, 20))
    row = np.floor(y)
    across = x / rng.uniform(1.5, 3) + 0.5 * (row % 2)
    number = rng.random((64, 64)).astype(np.float32)[row.astype(int) % 64, np.floor(across).astype(int) % 64]
    base = colour(rng, (0, 0.12), (0.1, 0.6), (0.25, 0.85))
    rough = 1 + rng.uniform(0.03, 0.15) * noise(rng, side, 25, 4, 0.7)
    picture = ramp(number, [near(rng, base, 0.2), base]) * rough[..., None]
    edge = np.minimum(0.5 - np.abs(across % 1 - 0.5), 0.5 - np.abs(y % 1 - 0.5)) + 0.02 * noise(rng, side, 40)
    return blend(stone(rng) * rough[..., None], picture, step(edge - 0.05, 0.06))


def sand(rng: Rng, side: int) -> Top:
    """Draw rippled sand, water or satin: bent parallel waves, lit from one side."""
    _, y = grid(side)
    phase = (y + rng.uniform(0.01, 0.08) * noise(rng, side, rng.uniform(1.5, 5), 2)) * rng.uniform(4, 30)
    wave = np.sin(2 * np.pi * phase) * np.clip(0.7 + 0.4 * noise(rng, side, 4), 0, 1.5)
    base = colour(rng, (0.05, 0.7), (0, 0.5), (0.3, 0.9))
    return base * np.clip(1 + rng.uniform(0.05, 0.3) * wave + 0.05 * noise(rng, side, 100), 0.1, 1.6)[..., None]


def marbled_paper(rng: Rng, side: int) -> Top:
    """Draw marbled paper: stripes of ink, combed and stirred."""
    u, v = grid(side)
    for _ in range(rng.integers(1, 4)):
        u = u + rng.uniform(0.02, 0.15) * noise(rng, side, rng.uniform(1.5, 6), 2)
        v = v + rng.uniform(0.01, 0.05) * np.sin(2 * np.pi * u * rng.uniform(2, 12))
    field = (v * rng.uniform(3, 15)) % 1
    colours = [colour(rng) for _ in range(rng.integers(3, 7))]
    return np.asarray(colours)[np.minimum((field * len(colours)).astype(int), len(colours) - 1)]


def fur(rng: Rng, side: int) -> Top:
    """Draw a carpet, fur or grass: thousands of short hairs, combed in patches."""
    base = colour(rng, value=(0.15, 0.9))
    picture = sheet(base * np.float32(0.6), side)
    lean = noise(rng, side, rng.uniform(1.5, 6), 2)
    length = side * rng.uniform(0.015, 0.05)
    starts = rng.uniform(0, side, (900, 2))
    turn = rng.uniform(0, 6) + 0.6 * lean[starts[:, 1].astype(int), starts[:, 0].astype(int)] + rng.normal(0, 0.3, 900)
    stops = starts + np.stack([np.cos(turn), np.sin(turn)], -1) * length
    strands = points(np.stack([starts, stops], 1))
    for part in np.array_split(strands, 12):
        cv2.polylines(picture, list(part), False, ink(near(rng, base, 0.25)), 1, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def carbon_fibre(rng: Rng, side: int) -> Top:
    """Draw a satin twill of glossy ribbons: each crossing shines by its direction."""
    x, y = grid(side, rng.uniform(20, 70))
    over = (np.floor(x) + np.floor(y)) % 4 < 2
    gloss = np.sin(np.pi * np.where(over, x % 1, y % 1))
    base = colour(rng, saturation=(0, 0.6), value=(0.15, 0.7))
    return base * (np.where(over, 0.6, 1.0) * (0.6 + 0.4 * gloss))[..., None].astype(np.float32)


def quilt(rng: Rng, side: int) -> Top:
    """Draw padding stitched in diamonds or squares."""
    x, y = grid(side)
    n = rng.uniform(4, 18)
    u, v = ((x + y) * n, (x - y) * n) if rng.random() < 0.6 else (x * n, y * n)
    height = np.abs(np.sin(np.pi * u) * np.sin(np.pi * v)) ** rng.uniform(0.3, 0.8)
    right, down = (cv2.Sobel(height.astype(np.float32), -1, *along) for along in ((1, 0), (0, 1)))
    light = right * rng.uniform(-0.5, 0.5) + down * rng.uniform(-0.5, 0.5)
    return cloth(rng) * np.clip(0.8 + 0.2 * height + light, 0.2, 1.6)[..., None]


def plain(rng: Rng, side: int) -> Top:
    """Draw a painted or laminated top of one colour."""
    return colour(rng, saturation=(0, 0.7)) * (1 + 0.02 * rng.random() * noise(rng, side, 60, 2))[..., None]


def gradient(rng: Rng, side: int) -> Top:
    """Draw colours that run into one another."""
    x, y = grid(side)
    field = x + 0.3 * rng.normal() * y + 0.15 * rng.random() * noise(rng, side, 2, 2)
    return ramp((field - field.min()) / np.ptp(field), shades(rng))


def clouds(rng: Rng, side: int) -> Top:
    """Draw noise of several octaves in a few colours."""
    cells, levels = np.exp(rng.uniform(0.5, 4)), int(rng.integers(1, 6))
    field = noise(rng, side, cells, levels, rng.uniform(0.4, 0.9), rng.uniform(0.5, 4))
    return ramp(0.5 + rng.uniform(0.1, 0.4) * field, shades(rng))


def camouflage(rng: Rng, side: int) -> Top:
    """Draw blots with sharp edges, one over the other."""
    picture = colour(rng)
    for shade in shades(rng):
        field = noise(rng, side, np.exp(rng.uniform(1, 3.5)), int(rng.integers(1, 4)), 0.5, rng.uniform(0.5, 3))
        picture = blend(picture, shade, step(field - rng.uniform(0, 1.2), 0.1))
    return picture


def zigzag(rng: Rng, side: int) -> Top:
    """Draw chevrons or waves."""
    x, y = grid(side)
    n = rng.uniform(3, 15)
    wave = np.abs((x * n) % 1 - 0.5) * rng.uniform(0.5, 2) / n
    field = ((y + wave) * rng.uniform(4, 20)) % 1
    colours = shades(rng, 2, 4)
    return np.asarray(colours)[np.minimum((field * len(colours)).astype(int), len(colours) - 1)]


def motif(rng: Rng, radius: Field, angle: Field) -> Field:
    """Return a random ornament within radius 1: a disc, ring, star, flower, cross or diamond, from 0 to 1."""
    kind, points = rng.integers(6), float(rng.integers(3, 9))
    size = rng.uniform(0.4, 0.95)
    outline = (
        lambda: radius,
        lambda: np.abs(radius - 0.7 * size) + 0.7 * size,
        lambda: radius * (1 + 0.6 * np.abs(np.sin(angle * points / 2))),
        lambda: radius / (0.6 + 0.4 * np.cos(angle * points)),
        lambda: np.minimum(np.abs(np.cos(angle)), np.abs(np.sin(angle))) * radius * 3 + 0.2 * radius,
        lambda: radius * (np.abs(np.cos(angle)) + np.abs(np.sin(angle))),
    )[kind]()
    return step(size - outline, 0.1)


def lattice(rng: Rng, side: int) -> Top:
    """Draw ornaments on a lattice, as on printed cloth or oilcloth."""
    x, y = grid(side, float(np.exp(rng.uniform(1.4, 3.5))))
    stagger = 0.5 * float(rng.integers(2))
    u, v = x % 1 - 0.5, (y + stagger * (np.floor(x) % 2)) % 1 - 0.5
    picture = cloth(rng)
    for _ in range(rng.integers(1, 4)):
        radius, angle = np.hypot(u, v) * 2 / rng.uniform(0.3, 1), np.arctan2(v, u) + rng.uniform(0, 6)
        picture = blend(picture, cloth(rng), motif(rng, radius, angle))
        u, v = (u + 0.5 + 0.5 * float(rng.integers(2))) % 1 - 0.5, (v + 0.5 + 0.5 * float(rng.integers(2))) % 1 - 0.5
    return picture


def crossing_lines(rng: Rng, side: int) -> Top:
    """Draw scratches or threads that cross at random."""
    picture = sheet(colour(rng), side) if rng.random() < 0.5 else wet(clouds(rng, side))
    colours = shades(rng, 1, 3)
    for _ in range(rng.integers(5, 90)):
        start, angle = rng.uniform(-0.1, 1.1, 2) * side, rng.uniform(0, 2 * np.pi)
        stop = start + np.array([np.cos(angle), np.sin(angle)]) * side * rng.exponential(0.5)
        ends, shade = (points(start).tolist(), points(stop).tolist()), ink(colours[rng.integers(len(colours))])
        cv2.line(picture, *ends, shade, int(rng.integers(1, 4)), cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def square_tiles(rng: Rng, side: int) -> Top:
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


def hexagons(rng: Rng, side: int) -> Top:
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


def scales(rng: Rng, side: int) -> Top:
    """Draw overlapping scales or fans."""
    x, y = grid(side, rng.uniform(4, 20))
    picture, covered = np.zeros((side, side), np.float32), np.zeros((side, side), bool)
    for layer in range(3):
        row = np.floor(y * 2) + layer
        u = (x + 0.5 * (row % 2)) % 1 - 0.5
        distance = np.hypot(u, (y * 2 - row) / 2)
        inside = (distance < 0.5) & ~covered
        picture = np.where(inside, distance * 2, picture)
        covered |= inside
    rings = (picture * rng.integers(1, 6)) % 1
    return ramp(rings if rng.random() < 0.6 else picture, shades(rng, 2, 4))


def truchet(rng: Rng, side: int) -> Top:
    """Draw a maze of arcs: square tiles with two quarter circles each, turned at random."""
    x, y = grid(side, rng.uniform(4, 20))
    flip = rng.random((64, 64))[np.floor(y).astype(int), np.floor(x).astype(int)] < 0.5
    u, v = np.where(flip, 1 - x % 1, x % 1), y % 1
    radius = np.minimum(np.hypot(u, v), np.hypot(1 - u, 1 - v))
    return ramp(1 - step(np.abs(radius - 0.5) - rng.uniform(0.05, 0.25), 0.05), shades(rng, 2, 2))


def rays(rng: Rng, side: int) -> Top:
    """Draw rings or rays about a point, as of turned wood, a sunburst or a woven mat."""
    x, y = grid(side)
    centre = rng.uniform(-0.2, 1.2, 2)
    radius, angle = np.hypot(x - centre[0], y - centre[1]), np.arctan2(y - centre[1], x - centre[0])
    if (kind := rng.integers(3)) < 2:
        field = (radius * rng.uniform(4, 30), angle / 2 / np.pi * rng.integers(6, 40))[kind]
    else:
        field = radius * rng.uniform(3, 15) + angle / 2 / np.pi * rng.integers(1, 6)
    wave = 0.5 + 0.5 * np.sin(2 * np.pi * field)
    wave = wave if rng.random() < 0.5 else step(wave - 0.45, 0.1)
    return ramp(wave.astype(np.float32), shades(rng, 2, 4)) * (1 + 0.04 * noise(rng, side, 30, 3))[..., None]


def waves(rng: Rng, side: int) -> Top:
    """Draw plane waves that cross, as in quasi-crystals and guilloche."""
    x, y = grid(side)
    field = np.zeros((side, side), np.float32)
    for turn in np.arange(count := int(rng.integers(2, 8))) * np.pi / count + rng.normal(0, 0.05, count):
        field += np.sin(2 * np.pi * rng.uniform(4, 25) * (x * np.cos(turn) + y * np.sin(turn)) + rng.uniform(0, 6))
    field = field / np.sqrt(count)
    return ramp(step(field, 0.2) if rng.random() < 0.4 else 0.5 + 0.3 * field, shades(rng, 2, 4))


def labyrinth(rng: Rng, side: int) -> Top:
    """Draw the spots and worms of noise of one wavelength, as on shells and leather."""
    wave = np.exp(rng.uniform(0.7, 2.2))
    field = rng.standard_normal((side, side), np.float32)
    fine, broad = (cv2.GaussianBlur(field, (0, 0), w, borderType=cv2.BORDER_REFLECT) for w in (wave, wave * 1.6))
    field = fine - broad
    return ramp(step(field / field.std() - rng.uniform(-0.8, 0.8), rng.uniform(0.1, 1)), shades(rng, 2, 3))


def leather(rng: Rng, side: int) -> Top:
    """Draw leather or felt: a fine relief, lit from one side."""
    height = noise(rng, side, rng.uniform(20, 90), 3, 0.7)
    light = cv2.Sobel(height, -1, 1, 0) * rng.uniform(0.01, 0.06)
    base = colour(rng, value=(0.1, 0.7))
    return base * np.clip(1 + light + 0.08 * noise(rng, side, 3, 3), 0.3, 1.8)[..., None]


def brushed_metal(rng: Rng, side: int) -> Top:
    """Draw brushed steel or brass: fine streaks and broad reflections across them."""
    base = colour(rng, (0.05, 0.65), (0, 0.3), (0.4, 0.9))
    _, y = grid(side)
    streaks = noise(rng, side, side / 2, stretch=60) * rng.uniform(0.02, 0.1)
    glow = 0.3 * rng.random() * np.sin(2 * np.pi * (y * rng.uniform(0.5, 2.5) + rng.random()))
    return base * (1 + streaks + glow)[..., None]


def cork(rng: Rng, side: int) -> Top:
    """Draw cork: crumbs of one brown with dark flecks."""
    number, _, _ = cells(rng, side, int(rng.uniform(900, 3000)))
    base = colour(rng, (0.05, 0.11), (0.3, 0.65), (0.45, 0.85))
    picture = base * (0.8 + 0.35 * number + 0.06 * noise(rng, side, 100))[..., None]
    return blend(picture, base * 0.35, step(noise(rng, side, 70) - 1.6, 0.3) * 0.9)


def flowers(rng: Rng, side: int) -> Top:
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


def writing(rng: Rng, side: int) -> Top:
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


def contours(rng: Rng, side: int) -> Top:
    """Draw a map: coloured heights with contour lines and roads."""
    height = noise(rng, side, rng.uniform(1.5, 5), 4, 0.45)
    picture = ramp(0.5 + 0.25 * height, shades(rng, 2, 5))
    lines = 1 - step(np.abs((height * rng.uniform(2, 8)) % 1 - 0.5) - 0.03, 0.06)
    picture = blend(picture, colour(rng, value=(0.05, 0.6)), lines * rng.uniform(0.2, 1))
    roads = np.exp(-((noise(rng, side, 3, 2) / 0.04) ** 2))
    return blend(picture, colour(rng), roads * float(rng.integers(0, 2)))


def halftone(rng: Rng, side: int) -> Top:
    """Draw a picture printed in dots whose size follows its darkness."""
    x, y = grid(side)
    n, turn = rng.uniform(25, 80), rng.uniform(0, np.pi)
    u, v = (x * np.cos(turn) + y * np.sin(turn)) * n, (y * np.cos(turn) - x * np.sin(turn)) * n
    screen = np.cos(2 * np.pi * u) + np.cos(2 * np.pi * v)
    tone = noise(rng, side, rng.uniform(1.5, 5), 2) * rng.uniform(0.3, 1.2)
    return ramp(step(screen + tone, 0.4), shades(rng, 2, 2))


def patchwork(rng: Rng, side: int) -> Top:
    """Draw patches of printed cloth sewn together, each with its own print."""
    n = int(rng.integers(4, 11))
    x, y = grid(side)
    place = np.floor(y * n).astype(int), np.floor(x * n).astype(int)
    kinds = rng.integers(0, 4, (n, n))[place]
    ground, print_ = (rng.random((n, n, 3)).astype(np.float32)[place] for _ in range(2))
    k = rng.uniform(3, 9) * n
    u, v = x * k % 1 - 0.5, y * k % 1 - 0.5
    share = np.select([kinds == 1, kinds == 2, kinds == 3], [np.hypot(u, v) < 0.3, u > 0, (u > 0) ^ (v > 0)], False)
    if rng.random() < 0.4:
        share &= (x * n % 1) > (y * n % 1)
    picture = blend(ground, print_, share.astype(np.float32))
    return (picture + (cloth(rng) - picture) * np.float32(rng.uniform(0, 0.6))).astype(np.float32)


def houndstooth(rng: Rng, side: int) -> Top:
    """Draw houndstooth: broken checks of two colours."""
    u, v = (along % 1 for along in grid(side, rng.uniform(6, 30)))
    dark = np.where((u < 0.5) == (v < 0.5), u < 0.5, ((u + v) * 2) % 1 < 0.5)
    return ramp(dark.astype(np.float32), [cloth(rng), cloth(rng)])


def argyle(rng: Rng, side: int) -> Top:
    """Draw diamonds with thin lines that cross them."""
    (x, y), slim = grid(side, rng.uniform(3, 12)), rng.uniform(0.5, 0.9)
    u, v = x + y * slim, x - y * slim
    picture = ramp(((np.floor(u) + np.floor(v)) % 2 + (np.floor(u) % 2) * 0.5) / 1.5, shades(rng, 3, 4))
    line = np.minimum(np.abs(u % 1 - 0.5), np.abs(v % 1 - 0.5))
    return blend(picture, colour(rng), 1 - step(line - 0.015, 0.03))


def ruled(rng: Rng, side: int) -> Top:
    """Draw a cutting mat or squared paper: fine lines and bold ones."""
    x, y = grid(side)
    n, every = rng.uniform(8, 50), int(rng.integers(2, 11))
    fine = np.minimum(np.abs(x * n % 1 - 0.5), np.abs(y * n % 1 - 0.5)) / n
    bold = np.minimum(np.abs(x * n / every % 1 - 0.5), np.abs(y * n / every % 1 - 0.5)) * every / n
    base, line = colour(rng), colour(rng)
    picture = blend(base, line, (1 - step(fine, 0.003)) * rng.uniform(0.1, 0.6))
    return blend(picture, line, 1 - step(bold - 0.001, 0.004))


def brush(rng: Rng, side: int) -> Top:
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


def spirals(rng: Rng, side: int) -> Top:
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


def newspaper(rng: Rng, side: int) -> Top:
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
    return blend(paper, black, share)


def dead_leaves(rng: Rng, side: int) -> Top:
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


def random_network(rng: Rng, side: int) -> Top:
    """Draw the output of a small random network whose inputs are a pixel's place and some noise."""
    x, y = grid(side // 2)  # coarser, to save time
    inputs = [x - 0.5, y - 0.5, np.hypot(x - rng.random(), y - rng.random()), 0.1 * noise(rng, side // 2, 6, 2)]
    layer = np.stack(inputs, -1) * np.float32(rng.uniform(4, 40))
    for width in (10, 10, 3):
        weights = rng.normal(0, 1.2 / np.sqrt(layer.shape[-1]), (layer.shape[-1], width)).astype(np.float32)
        mixed = layer @ weights + rng.normal(0, 1, width).astype(np.float32)
        layer = np.sin(mixed * np.float32(rng.uniform(0.7, 2))) if rng.random() < 0.6 else np.tanh(mixed)
    picture = np.clip(0.5 + 0.4 * layer, 0, 1)
    tone = colour(rng)
    picture = tone + (picture - tone) * np.float32(rng.uniform(0.2, 0.9))
    return cv2.resize(picture, (side, side), interpolation=cv2.INTER_CUBIC)


def wallpaper(rng: Rng, side: int) -> Top:
    """Draw a random picture, repeated or mirrored as on wallpaper, oilcloth or carpets."""
    n = int(rng.integers(2, 10))
    source = dead_leaves if rng.random() < 0.5 else random_network
    tile = cv2.resize(source(rng, side), (side // n + 1,) * 2, interpolation=cv2.INTER_AREA)
    if rng.random() < 0.6:
        tile = np.hstack([tile, tile[:, ::-1]])
    if rng.random() < 0.6:
        tile = np.vstack([tile, tile[::-1]])
    return np.tile(tile, (n + 1, n + 1, 1))[:side, :side]


def flow(rng: Rng, side: int) -> Top:
    """Draw noise smeared along a flow: burls, combed plaster, brushed paint."""
    angle = noise(rng, side, rng.uniform(1.5, 5), 2, 0.4) * rng.uniform(0.3, 1.5) + rng.uniform(0, 6)
    length = rng.uniform(0.002, 0.012)
    right, down = np.cos(angle) * np.float32(length), np.sin(angle) * np.float32(length)
    field: Field = noise(rng, side, rng.uniform(25, 120), 2, 0.7)
    for reach in (1, 2, 4):
        field = (field + bend(field, right * reach, down * reach)) / 2
    field = field / max(float(field.std()), 1e-3)
    return ramp(0.5 + rng.uniform(0.1, 0.35) * field, shades(rng, 2, 3))


def dabs(rng: Rng, side: int) -> Top:
    """Draw dabs of a sponge: one speckled print, stamped over and over."""
    picture = np.full((side, side, 3), colour(rng), np.float32)
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


TAUGHT = (
    planks, cathedral_grain, bamboo, marble, granite, slate, cracked, pebbles, plain_cloth, crumpled,
    striped_cloth, gingham, damask, basket, bricks, marbled_paper, quilt, plain, gradient, clouds, camouflage,
    zigzag, lattice, crossing_lines, square_tiles, scales, rays, waves, labyrinth, leather, flowers, writing,
    contours, patchwork, argyle, ruled, brush, dead_leaves, random_network, wallpaper, flow,
)  # fmt: skip
HELD_OUT = (
    herringbone, terrazzo, agate, tartan, knit, lace, sand, fur, carbon_fibre, hexagons, truchet, brushed_metal,
    cork, newspaper, houndstooth, halftone, spirals, dabs,
)  # fmt: skip
