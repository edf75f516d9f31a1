"""Draw table tops of wood, stone, cloth and other materials. Boards and threads run along x."""

import cv2
import numpy as np

from making.segmenter.paint import (
    FRACTION_BITS,
    Colour,
    Field,
    Number,
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
    sheet,
    step,
    stone,
    wet,
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


def marble(rng: np.random.Generator, side: int) -> Top:
    """Draw marble: thin veins where warped noise crosses zero, over clouds."""
    base, vein = stone(rng), stone(rng)
    picture = ramp(0.5 + 0.2 * noise(rng, side, rng.uniform(2, 6), 4, 0.6), [near(rng, base, 0.1), base])
    for _ in range(rng.integers(1, 5)):
        crossing = np.abs(noise(rng, side, rng.uniform(1.5, 7), 5, rng.uniform(0.4, 0.65), rng.uniform(0.5, 2)))
        share = np.exp(-crossing / rng.uniform(0.01, 0.15)) * step(noise(rng, side, 3) + 1, 1.5)
        picture = blend(picture, near(rng, vein, 0.1), share * rng.uniform(0.2, 1))
    return picture


def speckles(rng: np.random.Generator, side: int) -> Field:
    """Return noise of grains, some 5 to 40 mm wide, with mean 0 and standard deviation 1.1."""
    return noise(rng, side, rng.uniform(60, 240), 1) + 0.5 * noise(rng, side, rng.uniform(30, 120))


def granite(rng: np.random.Generator, side: int) -> Top:
    """Draw granite: grains of two to four minerals over a base."""
    base = stone(rng)
    minerals = [near(rng, base, rng.uniform(0.05, 0.4)) for _ in range(rng.integers(2, 5))]
    picture = flat(side, base)
    for mineral in minerals:
        grains = step(speckles(rng, side) - rng.uniform(0.2, 1.8), 0.3)
        picture = blend(picture, mineral, grains * rng.uniform(0.3, 1))
    return picture * (1 + rng.uniform(0, 0.15) * noise(rng, side, 3, 3))[..., None]


def checks(rng: np.random.Generator, side: int) -> Top:
    """Draw the checks of gingham: two colours and their mixture where the bands cross."""
    x, y = grid(side)
    n = rng.uniform(5, 45)
    share = ((x * n % 1 < 0.5).astype(np.float32) + (y * n % 1 < 0.5)) / 2
    base = cloth(rng)
    return ramp(share, [base, near(rng, base, 0.25) if rng.random() < 0.3 else cloth(rng)])


def weave(rng: np.random.Generator, side: int) -> Top:
    """Draw a coarse weave, as of rush, raffia or burlap."""
    x, y = grid(side)
    n, m = rng.uniform(15, 90), rng.uniform(15, 90)
    over = ((np.floor(x * n) + np.floor(y * m)) % 2).astype(np.float32)
    bulge = np.where(over > 0, np.sin(np.pi * (y * m % 1)), np.sin(np.pi * (x * n % 1)))
    warp, weft = cloth(rng), cloth(rng)
    if rng.random() < 0.6:
        weft = near(rng, warp, 0.1)
    picture = ramp(over, [warp, weft]) * (1 - rng.uniform(0.1, 0.5) * (1 - bulge))[..., None]
    return picture * (1 + 0.08 * noise(rng, side, 60, 2, stretch=3))[..., None]


def ironed_folds(rng: np.random.Generator, picture: Top) -> Top:
    """Return a cloth with the creases of having been folded, lit from one side."""
    x, y = grid(len(picture))
    shade = np.ones(x.shape, np.float32)
    for along in (x, y):
        for place in ((np.arange(rng.integers(0, 4)) + rng.random()) / 3).tolist():
            side_of_fold = (along - place) / rng.uniform(0.005, 0.03)
            shade = shade + rng.uniform(-0.25, 0.25) * side_of_fold * np.exp(-(side_of_fold**2))
    return picture * shade[..., None]


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


def concrete(rng: np.random.Generator, side: int) -> Top:
    """Draw concrete or plaster: clouds, trowel marks and pores."""
    base = stone(rng)
    clouds = rng.uniform(0.02, 0.12) * noise(rng, side, rng.uniform(2, 8), 5, rng.uniform(0.4, 0.8))
    picture = base * (1 + clouds)[..., None]
    pores = step(noise(rng, side, 120) - rng.uniform(1.8, 3), 0.4)
    return blend(picture, picture * 0.5, pores)


def slate(rng: np.random.Generator, side: int) -> Top:
    """Draw slate: a split surface with steps that catch the light."""
    height = noise(rng, side, rng.uniform(2, 6), 5, 0.55, rng.uniform(1, 4))
    layers = np.floor(height * rng.uniform(1, 4)) + 0.3 * height
    light = cv2.Sobel(cv2.GaussianBlur(layers, (0, 0), 0.8), -1, 1, 0, ksize=3)
    base = colour(rng, (0.45, 0.75), (0, 0.25), (0.1, 0.5))
    return base * np.clip(1 + rng.uniform(0.05, 0.2) * light + 0.05 * height, 0.3, 2)[..., None]


def travertine(rng: np.random.Generator, side: int) -> Top:
    """Draw travertine: beds with rows of holes."""
    beds = noise(rng, side, rng.uniform(6, 20), 4, 0.6, rng.uniform(5, 15))
    base = colour(rng, (0.05, 0.13), (0.05, 0.35), (0.5, 0.95))
    picture = ramp(0.5 + 0.2 * beds, [near(rng, base, 0.15), base, near(rng, base, 0.08)])
    holes = step(noise(rng, side, 60, 2, stretch=3) + 0.4 * beds - rng.uniform(1.8, 2.6), 0.4)
    return blend(picture, base * 0.4, holes * rng.uniform(0.3, 1))


def agate(rng: np.random.Generator, side: int) -> Top:
    """Draw agate or onyx: many bands that follow one another."""
    height = noise(rng, side, rng.uniform(1.5, 4), 3, 0.4)
    bands = 0.5 + 0.5 * np.sin(height * rng.uniform(6, 30) + 2 * np.sin(height * rng.uniform(2, 9)))
    shades = [colour(rng, saturation=(0, 0.7)) for _ in range(rng.integers(2, 5))]
    return ramp(bands, shades) * (1 + 0.05 * noise(rng, side, 20, 3))[..., None]


def cells(rng: np.random.Generator, side: int, count: int, jitter: float = 1.0) -> tuple[Field, Field, Field]:
    """Return Voronoi cells: a random number for each cell, the distance to its point and the distance from its edge.

    Distances are shares of the side. The points lie on a grid, shifted by up to `jitter` of half its step.
    """
    n = max(int(np.sqrt(count)), 2)
    places = (
        np.stack(np.meshgrid(np.arange(n) + 0.5, np.arange(n) + 0.5), -1) + rng.uniform(-0.5, 0.5, (n, n, 2)) * jitter
    )
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


def terrazzo(rng: np.random.Generator, side: int) -> Top:
    """Draw terrazzo: chips of several stones in a cement."""
    base = stone(rng)
    picture = wet(base * (1 + 0.03 * noise(rng, side, 80, 2))[..., None])
    chips = [colour(rng, saturation=(0, 0.6)) for _ in range(rng.integers(2, 6))]
    length = rng.uniform(0.006, 0.03)
    for _ in range(int(min(0.35 / length**2, 900))):
        corners = rng.uniform(0, side, 2) + rng.normal(
            0, length * side * rng.uniform(0.3, 0.8), (rng.integers(4, 7), 2)
        )
        shade = ink(chips[rng.integers(len(chips))])
        cv2.fillConvexPoly(picture, cv2.convexHull(points(corners)), shade, cv2.LINE_AA, FRACTION_BITS)
    return dried(picture)


def cracked(rng: np.random.Generator, side: int) -> Top:
    """Draw a cracked glaze, mud or leather: cells with dark or light seams."""
    number, _, edge = cells(rng, side, int(np.exp(rng.uniform(3.5, 7))))
    base = colour(rng)
    picture = base * (1 + rng.uniform(0, 0.4) * (number - 0.5) + 0.06 * noise(rng, side, 20, 3))[..., None]
    seam = 1 - step(edge - rng.uniform(0, 0.003), rng.uniform(0.003, 0.012))
    return blend(
        picture, picture * 0.4 if rng.random() < 0.7 else np.float32(1) - 0.3 * picture, seam * rng.uniform(0.3, 1)
    )


def pebbles(rng: np.random.Generator, side: int) -> Top:
    """Draw rounded pebbles in a mortar."""
    number, middle, edge = cells(rng, side, int(np.exp(rng.uniform(4.5, 7))))
    shades: list[Colour] = [stone(rng) for _ in range(4)]
    picture = ramp(number, shades) * (1.1 - middle / max(float(middle.max()), 1e-3) * 0.5)[..., None]
    return blend(stone(rng) * np.ones((side, side, 1), np.float32), picture, step(edge - 0.004, 0.006))


def threads(rng: np.random.Generator, side: int, strength: float) -> Field:
    """Return the gain of uneven warp and weft threads, about 1."""
    warp, weft = noise(rng, side, 120, stretch=20), noise(rng, side, 120, stretch=20).T
    return 1 + np.float32(strength) * (warp + weft)


def draped(rng: np.random.Generator, picture: Top) -> Top:
    """Return a cloth that lies unevenly: its pattern is bent and its folds are shaded."""
    side = len(picture)
    height = noise(rng, side, rng.uniform(1.2, 4), 2, 0.4, rng.uniform(1, 3))
    slope_x, slope_y = cv2.Sobel(height, -1, 1, 0, scale=side / 900), cv2.Sobel(height, -1, 0, 1, scale=side / 900)
    strength = rng.uniform(0, 1) ** 2
    bent = bend(picture, slope_x * np.float32(0.02 * strength), slope_y * np.float32(0.02 * strength))
    shade = 1 + np.float32(0.12 * strength) * (slope_x + rng.uniform(-1, 1) * slope_y)
    return bent * np.clip(shade, 0.4, 1.5)[..., None]


def finished(rng: np.random.Generator, picture: Top) -> Top:
    """Return a woven picture as a cloth on a table: threads, then folds or creases or both."""
    picture = picture * threads(rng, len(picture), rng.uniform(0, 0.06))[..., None]
    chance = rng.random()
    if chance < 0.55:
        picture = draped(rng, picture)
    return ironed_folds(rng, picture) if chance > 0.4 and chance < 0.75 else picture


def plain_cloth(rng: np.random.Generator, side: int) -> Top:
    """Draw a cloth of one colour."""
    return finished(rng, flat(side, cloth(rng)))


def crumpled(rng: np.random.Generator, side: int) -> Top:
    """Draw a crumpled cloth or paper: facets with sharp creases."""
    height = np.zeros((side, side), np.float32)
    for _ in range(rng.integers(3, 7)):
        height += np.abs(noise(rng, side, rng.uniform(2, 8), 2, 0.4))
    light = cv2.Sobel(height, -1, 1, 0, scale=side / 900) + rng.uniform(-1, 1) * cv2.Sobel(
        height, -1, 0, 1, scale=side / 900
    )
    return cloth(rng) * np.clip(1 + rng.uniform(0.02, 0.12) * light, 0.3, 1.6)[..., None]


def band_shares(rng: np.random.Generator, side: int) -> tuple[Field, Field]:
    """Return one sequence of stripes along x and along y, as each stripe's random number from 0 to 1."""
    widths = rng.uniform(0.1, 1, rng.integers(2, 9)) ** 2 + 0.02
    ends = np.cumsum(widths) / widths.sum()
    numbers = rng.random(len(ends)).astype(np.float32)
    repeats = rng.uniform(2, 14)
    x, y = grid(side)
    stripe = [numbers[np.minimum(np.searchsorted(ends, (along * repeats) % 1), len(ends) - 1)] for along in (y, x)]
    return stripe[0], stripe[1]


def striped_cloth(rng: np.random.Generator, side: int) -> Top:
    """Draw a striped cloth."""
    stripes, _ = band_shares(rng, side)
    return finished(rng, ramp(stripes, [cloth(rng) for _ in range(rng.integers(2, 4))]))


def gingham(rng: np.random.Generator, side: int) -> Top:
    """Draw a checked cloth."""
    return finished(rng, checks(rng, side))


def tartan(rng: np.random.Generator, side: int) -> Top:
    """Draw a tartan: one sequence of stripes, woven both ways with a twill."""
    rows, columns = band_shares(rng, side)
    shades = [cloth(rng) for _ in range(rng.integers(3, 6))]
    x, y = grid(side)
    twill = 0.5 + 0.5 * np.sin((x + y) * 2 * np.pi * rng.uniform(40, 100)) * rng.uniform(0, 1)
    return finished(rng, blend(ramp(rows, shades), ramp(columns, shades), twill.astype(np.float32)))


def twill(rng: np.random.Generator, side: int) -> Top:
    """Draw denim or another twill: fine diagonals of dark and light threads."""
    x, y = grid(side)
    n = rng.uniform(40, 110)
    lines = 0.5 + 0.5 * np.sin(2 * np.pi * n * (x + y * rng.uniform(0.4, 1.2)))
    base = cloth(rng)
    field = np.clip(0.5 * lines + 0.25 + 0.12 * noise(rng, side, 90, 2, stretch=6), 0, 1)
    return finished(rng, ramp(field, [base * rng.uniform(0.5, 0.85), base]))


def damask(rng: np.random.Generator, side: int) -> Top:
    """Draw damask: mirrored ornaments, told from their ground by the gloss of the threads alone."""
    n = int(rng.integers(2, 9))
    tile = max(side // n, 16)
    quarter = noise(rng, max(tile // 2, 8), rng.uniform(2, 5), 2, 0.5)
    half = np.hstack([quarter, quarter[:, ::-1]])
    motif = np.vstack([half, half[::-1]]) if rng.random() < 0.5 else np.vstack([half, np.roll(half, len(quarter), 1)])
    field = np.tile(motif, (n + 2, n + 2))[:side, :side]
    field = cv2.resize(field, (side, side))
    base = cloth(rng)
    return finished(
        rng, ramp(step(field - rng.uniform(-0.3, 0.5), 0.15), [base, near(rng, base, rng.uniform(0.03, 0.2))])
    )


def knit(rng: np.random.Generator, side: int) -> Top:
    """Draw knitting: columns of V-shaped stitches."""
    x, y = grid(side)
    n = rng.uniform(15, 60)
    u = np.abs(x * n % 1 - 0.5)
    v = (y * n * rng.uniform(0.8, 1.3) + u * rng.uniform(0.8, 2)) % 1
    stitch = np.sin(np.pi * v) * (1 - (2 * u - 0.5) ** 2)
    shades: list[Colour] = [cloth(rng)]
    rows = np.floor(y * n) % rng.integers(4, 20) < rng.integers(0, 6)
    picture = np.where(rows[..., None], cloth(rng), shades[0])
    return finished(rng, (picture * (0.45 + 0.55 * stitch)[..., None]).astype(np.float32))


def lace(rng: np.random.Generator, side: int) -> Top:
    """Draw lace over a table: threads around holes, in rosettes."""
    x, y = grid(side)
    n = rng.uniform(4, 14)
    u, v = (x * n) % 1 - 0.5, (y * n + 0.5 * (np.floor(x * n) % 2)) % 1 - 0.5
    radius, angle = np.hypot(u, v), np.arctan2(v, u)
    petals = np.cos(angle * float(rng.integers(5, 12))) * rng.uniform(0.2, 0.8)
    rosette = np.sin(radius * 2 * np.pi * rng.uniform(3, 6) + petals * 2)
    net = np.maximum(np.sin(x * 2 * np.pi * n * 5), np.sin(y * 2 * np.pi * n * 5))
    thread = np.where(radius < 0.42, rosette, net)
    under = flat(side, colour(rng)) * (1 + 0.05 * noise(rng, side, 20, 3, stretch=8))[..., None]
    return blend(
        under, colour(rng, saturation=(0, 0.2), value=(0.7, 1)), step(thread + rng.uniform(-0.2, 0.4), 0.4) * 0.9
    )


def basket(rng: np.random.Generator, side: int) -> Top:
    """Draw a basket weave: pairs or triples of canes, over and under."""
    x, y = grid(side)
    n, canes = rng.uniform(8, 30), int(rng.integers(2, 5))
    lies = (np.floor(x * n) + np.floor(y * n)) % 2 > 0
    u, v = x * n % 1, y * n % 1
    across, along = np.where(lies, v, u), np.where(lies, u, v)
    round_cane = np.abs(np.sin(np.pi * across * canes)) ** rng.uniform(0.3, 1)
    light = (0.4 + 0.6 * round_cane) * (0.6 + 0.4 * np.sin(np.pi * along))
    base = wood(rng) if rng.random() < 0.7 else cloth(rng)
    picture = ramp(np.clip(0.5 + 0.15 * noise(rng, side, 60, 2), 0, 1), [near(rng, base, 0.1), base])
    return picture * light[..., None]


def rush_mat(rng: np.random.Generator, side: int) -> Top:
    """Draw slats or rushes side by side, tied with threads across."""
    x, y = grid(side)
    n = rng.uniform(40, 130)
    row = np.floor(y * n).astype(int)
    shade = rng.normal(1, rng.uniform(0.03, 0.2), row.max() + 1).astype(np.float32)[row]
    light = shade * (0.6 + 0.4 * np.abs(np.sin(np.pi * y * n)))
    thread = np.abs((x * rng.uniform(3, 15)) % 1 - 0.5) < rng.uniform(0.01, 0.06)
    picture = wood(rng) * light[..., None]
    return blend(picture, cloth(rng), (thread & (row % 2 == 0)).astype(np.float32) * 0.8)


def bricks(rng: np.random.Generator, side: int) -> Top:
    """Draw bricks or pavers, each weathered on its own."""
    x, y = grid(side)
    n = rng.uniform(6, 20)
    row = np.floor(y * n)
    across = x * n / rng.uniform(1.5, 3) + 0.5 * (row % 2)
    number = rng.random((64, 64)).astype(np.float32)[row.astype(int) % 64, np.floor(across).astype(int) % 64]
    base = colour(rng, (0, 0.12), (0.1, 0.6), (0.25, 0.85))
    rough = 1 + rng.uniform(0.03, 0.15) * noise(rng, side, 25, 4, 0.7)
    picture = ramp(number, [near(rng, base, 0.2), base]) * rough[..., None]
    edge = np.minimum(0.5 - np.abs(across % 1 - 0.5), 0.5 - np.abs(y * n % 1 - 0.5)) + 0.02 * noise(rng, side, 40)
    return blend(stone(rng) * rough[..., None], picture, step(edge - 0.05, 0.06))


def sand(rng: np.random.Generator, side: int) -> Top:
    """Draw rippled sand, water or satin: bent parallel waves, lit from one side."""
    _, y = grid(side)
    phase = (y + rng.uniform(0.01, 0.08) * noise(rng, side, rng.uniform(1.5, 5), 2)) * rng.uniform(4, 30)
    wave = np.sin(2 * np.pi * phase) * np.clip(0.7 + 0.4 * noise(rng, side, 4), 0, 1.5)
    base = colour(rng, (0.05, 0.7), (0, 0.5), (0.3, 0.9))
    return base * np.clip(1 + rng.uniform(0.05, 0.3) * wave + 0.05 * noise(rng, side, 100), 0.1, 1.6)[..., None]


def marbled_paper(rng: np.random.Generator, side: int) -> Top:
    """Draw marbled paper: stripes of ink, combed and stirred."""
    x, y = grid(side)
    u, v = x, y
    for _ in range(rng.integers(1, 4)):
        u = u + rng.uniform(0.02, 0.15) * noise(rng, side, rng.uniform(1.5, 6), 2)
        v = v + rng.uniform(0.01, 0.05) * np.sin(2 * np.pi * u * rng.uniform(2, 12))
    field = (v * rng.uniform(3, 15)) % 1
    shades = [colour(rng) for _ in range(rng.integers(3, 7))]
    return np.asarray(shades)[np.minimum((field * len(shades)).astype(int), len(shades) - 1)]


def rust(rng: np.random.Generator, side: int) -> Top:
    """Draw worn metal: patina or rust that eats a painted sheet."""
    paint, eaten = colour(rng), colour(rng, (0.02, 0.5), (0.2, 0.8), (0.15, 0.6))
    field = noise(rng, side, rng.uniform(3, 12), 6, 0.7)
    rough = 1 + 0.12 * noise(rng, side, 60, 2)
    picture = blend(flat(side, paint), eaten * rough[..., None], step(field - rng.uniform(-0.5, 1), 0.4))
    return picture * (1 - 0.3 * step(np.abs(field - 0.3) * -1 + 0.05, 0.05))[..., None]


def fur(rng: np.random.Generator, side: int) -> Top:
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


def perforated(rng: np.random.Generator, side: int) -> Top:
    """Draw perforated or embossed sheet: holes or studs in rows, each lit from one side."""
    x, y = grid(side)
    n = rng.uniform(12, 45)
    row = np.floor(y * n)
    u, v = (x * n + 0.5 * (row % 2)) % 1 - 0.5, y * n % 1 - 0.5
    if rng.random() < 0.4:
        u, v = u + v * (1 - 2 * (row % 2)), v - u * (1 - 2 * (row % 2))
    radius = np.hypot(u, v * rng.uniform(0.5, 1.5))
    spot = 1 - step(radius - rng.uniform(0.15, 0.35), 0.08)
    base = colour(rng, saturation=(0, 0.4), value=(0.3, 0.9))
    light = 1 + spot * (rng.uniform(-0.8, 0.2) + rng.uniform(-1.5, 1.5) * u + rng.uniform(-1.5, 1.5) * v)
    return base * np.clip(light + 0.03 * noise(rng, side, 40, 2), 0.05, 1.6)[..., None]


def carbon_fibre(rng: np.random.Generator, side: int) -> Top:
    """Draw a satin twill of glossy ribbons: each crossing shines by its direction."""
    x, y = grid(side)
    n = rng.uniform(20, 70)
    i, j = np.floor(x * n), np.floor(y * n)
    over = (i + j) % 4 < 2
    gloss = np.where(over, np.sin(np.pi * (x * n % 1)), np.sin(np.pi * (y * n % 1)))
    base = colour(rng, saturation=(0, 0.6), value=(0.15, 0.7))
    return base * (np.where(over, 0.6, 1.0) * (0.6 + 0.4 * gloss))[..., None].astype(np.float32)


def frosted(rng: np.random.Generator, side: int) -> Top:
    """Draw a pane of frosted or ribbed glass over something blurred."""
    under = dried(cv2.GaussianBlur(sheet_of_blots(rng, side), (0, 0), side * rng.uniform(0.02, 0.06)))
    x, _ = grid(side)
    ribs = rng.uniform(0, 0.1) * np.sin(2 * np.pi * x * rng.uniform(10, 70)) if rng.random() < 0.5 else 0
    return under * (1 + ribs + 0.03 * noise(rng, side, 80, 2))[..., None]


def sheet_of_blots(rng: np.random.Generator, side: int) -> np.ndarray:
    """Return a sheet with large blots of many colours."""
    drawn = sheet(colour(rng), side)
    for _ in range(rng.integers(4, 12)):
        centre, axes = rng.uniform(0, side, 2), rng.uniform(0.05, 0.4, 2) * side
        whole = points(centre).tolist(), points(axes).tolist(), rng.uniform(0, 180), 0, 360
        cv2.ellipse(drawn, *whole, ink(colour(rng)), -1, cv2.LINE_AA, FRACTION_BITS)
    return drawn


def towel(rng: np.random.Generator, side: int) -> Top:
    """Draw terry or velvet: a dense pile that is darker where it was stroked the other way."""
    base = cloth(rng)
    pile = rng.uniform(0.05, 0.2) * noise(rng, side, side / rng.uniform(1.5, 4))
    stroked = step(noise(rng, side, rng.uniform(1.5, 5), 2, 0.5, rng.uniform(1, 4)), rng.uniform(0.1, 2))
    picture = base * (1 + pile - rng.uniform(0, 0.3) * stroked)[..., None]
    _, y = grid(side)
    border = (np.abs((y * rng.uniform(1, 4)) % 1 - 0.5) < rng.uniform(0.02, 0.08)) & (rng.random() < 0.5)
    return blend(picture, cloth(rng), border.astype(np.float32))


def quilt(rng: np.random.Generator, side: int) -> Top:
    """Draw padding stitched in diamonds or squares."""
    x, y = grid(side)
    n = rng.uniform(4, 18)
    u, v = ((x + y) * n, (x - y) * n) if rng.random() < 0.6 else (x * n, y * n)
    height = np.abs(np.sin(np.pi * u) * np.sin(np.pi * v)) ** rng.uniform(0.3, 0.8)
    light = cv2.Sobel(height.astype(np.float32), -1, 1, 0) * rng.uniform(-0.5, 0.5) + cv2.Sobel(
        height.astype(np.float32), -1, 0, 1
    ) * rng.uniform(-0.5, 0.5)
    return cloth(rng) * np.clip(0.8 + 0.2 * height + light, 0.2, 1.6)[..., None]


GROUPS = (  # the taught and the held-out families of wood, of stone, of cloth and of other materials
    ((straight_grain, planks, butcher_block, cathedral_grain, bamboo, chipboard, worn_paint), (herringbone,)),
    ((marble, granite, concrete, slate, travertine, cracked, pebbles), (terrazzo, agate)),
    ((plain_cloth, crumpled, striped_cloth, gingham, weave, twill, damask), (tartan, knit, lace)),
    ((basket, bricks, marbled_paper, rust, frosted, towel, quilt, rush_mat, perforated), (sand, fur, carbon_fibre)),
)
