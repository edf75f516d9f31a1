"""Table tops of cloth."""

import cv2
import numpy as np

from making.segmenter.paint import (
    Colour,
    Field,
    Top,
    bend,
    blend,
    cloth,
    colour,
    flat,
    grid,
    near,
    noise,
    ramp,
    step,
)


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


TAUGHT = (plain_cloth, crumpled, striped_cloth, gingham, weave, twill, damask)
HELD_OUT = (tartan, knit, lace)
