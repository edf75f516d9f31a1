"""Table tops of stone and of what is cast like it."""

import cv2
import numpy as np

from making.segmenter.paint import (
    FRACTION_BITS,
    Colour,
    Field,
    Top,
    blend,
    colour,
    dried,
    flat,
    ink,
    near,
    noise,
    points,
    ramp,
    step,
    stone,
    wet,
)


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


TAUGHT = (marble, granite, concrete, slate, travertine, cracked, pebbles)
HELD_OUT = (terrazzo, agate)
