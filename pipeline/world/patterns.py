"""Procedural table tops: printed, woven, of wood and of stone. Boards and threads run along x."""

from collections.abc import Callable

import cv2
import numpy as np

from pipeline.world.paint import (
    Colour,
    Field,
    Number,
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
    stone,
    wood,
)


def shades(rng: np.random.Generator, least: int = 2, most: int = 5) -> list[Colour]:
    """Draw some colours: unrelated ones, or shades of one."""
    base = colour(rng)
    alike = rng.random() < 0.4
    return [near(rng, base, 0.2) if alike else colour(rng) for _ in range(rng.integers(least, most + 1))]


def stripes(rng: np.random.Generator, side: int) -> Top:
    """Draw printed stripes, straight or wavy."""
    x, y = grid(side)
    wave = rng.uniform(0, 0.03) * np.sin(x * 2 * np.pi * rng.uniform(0.5, 6)) if rng.random() < 0.5 else 0
    field = ((y + wave) * rng.uniform(3, 30)) % 1
    sharp = step(np.abs(field - 0.5) - rng.uniform(0.05, 0.4), 0.06)
    return ramp(sharp if rng.random() < 0.7 else field, shades(rng, 2, 4))


def checks(rng: np.random.Generator, side: int) -> Top:
    """Draw the checks of gingham: two colours and their mixture where the bands cross."""
    x, y = grid(side)
    n = rng.uniform(5, 45)
    share = ((x * n % 1 < 0.5).astype(np.float32) + (y * n % 1 < 0.5)) / 2
    base = cloth(rng)
    return ramp(share, [base, near(rng, base, 0.25) if rng.random() < 0.3 else cloth(rng)])


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


def folded(rng: np.random.Generator, picture: Top) -> Top:
    """Return a cloth that lies in folds and creases: its pattern is bent and its slopes are shaded."""
    height = noise(rng, len(picture), rng.uniform(2, 6), 2, 0.3, rng.uniform(1.5, 4))
    slope = cv2.Sobel(height, -1, 0, 1)
    slope = slope / float(slope.std())
    bent = bend(picture, np.zeros_like(slope), 0.006 * slope)
    return ironed_folds(rng, bent * np.clip(1 + rng.uniform(0.05, 0.15) * slope, 0.5, 1.5)[..., None])


PATTERNS: dict[str, Callable[[np.random.Generator, int], Top]] = {  # name -> draws a top of so many pixels a side
    "stripe": stripes, "check": checks, "plank": planks, "marble": marble, "granite": granite, "weave": weave,
}  # fmt: skip
CLOTHS = "stripe", "check", "weave"  # patterns that folds suit
