"""Draw random designs: any number of further validation items and table tops.

Radii stay within those of the training items, and stretched outlines are up to a tenth longer. Patterns, colours,
outlines and table tops are of all kinds. The experiment does not use them. They check choices that could overfit to few
items or tables (docs/decisions/020-robustness.md).
"""

import colorsys
from collections.abc import Iterator

import numpy as np

from making.data.cutlery import GOLD, PIECES, STEEL
from making.data.outline import ROUND, Outline, cut, eared, oval, polygon, scalloped, spouted
from making.data.surface import PATTERNS as SURFACE_PATTERNS

Colour = tuple[float, float, float]
Row = tuple  # a row of one of the tables in making.data.designs

PATTERNS = ("plain", "band", "rings", "rays", "petals", "dots", "checks", "speckles", "glaze", "spiral")
METALS = STEEL, GOLD, (0.74, 0.48, 0.36), (0.62, 0.63, 0.66)  # RGB [1 = white]
SLIM = {"chopsticks": 0.86, "tongs": 0.95}  # fixed slimness of these kinds
SHARPNESS = {4: 3.3, 6: 16.0, 8: 120.0, 10: 140.0, 12: 160.0}  # sharpness of a polygon by its number of corners


def varied(count: int, seed: int) -> dict[str, list[Row]]:
    """Return `count` validation items per symbol as rows of the tables in making.data.designs; a larger one adds."""
    items = list(_items(np.random.default_rng(seed), count))
    return {symbol: [rows[i] for rows in items] for i, symbol in enumerate(("bowl", "plate", "cutlery", "glass"))}


def varied_tops(count: int, seed: int) -> list[Row]:
    """Return `count` validation table tops, cycling through the patterns, as rows of making.data.designs' table."""
    rng, tops = np.random.default_rng([seed, 1]), []
    for i in range(count):
        hue, saturation, value = rng.uniform(0, 1), rng.uniform(0, 0.5), rng.uniform(0.25, 0.92)
        light = colorsys.hsv_to_rgb(hue, saturation, value)
        stain = rng.normal(0, 0.04), rng.uniform(0.8, 1.6), rng.uniform(0.55, 0.8)
        dark = colorsys.hsv_to_rgb((hue + stain[0]) % 1, min(1, saturation * stain[1]), value * stain[2])
        kind = SURFACE_PATTERNS[i % len(SURFACE_PATTERNS)]
        tops.append((f"{kind}-r{i}", "validation", kind, light, dark))
    return tops


def _items(rng: np.random.Generator, count: int) -> Iterator[tuple[Row, Row, Row, Row]]:
    def between(low: float, high: float, digits: int = 2) -> float:
        return round(rng.uniform(low, high), digits)

    def colour(saturation: tuple[float, float] = (0.0, 0.85), value: tuple[float, float] = (0.15, 0.97)) -> Colour:
        return colorsys.hsv_to_rgb(rng.uniform(0, 1), rng.uniform(*saturation), rng.uniform(*value))

    def one_of(choices):
        return choices[rng.integers(len(choices))]

    def outline(*kinds: str) -> Outline:
        kind = one_of(kinds)
        if kind == "oval":
            return oval(between(0.25, 0.65))
        if kind == "polygon":
            corners = int(rng.choice([4, 5, 6, 7, 8, 10, 12]))
            corners += corners % 2
            return polygon(corners, SHARPNESS[corners])
        if kind == "scalloped":
            return scalloped(int(rng.choice([4, 6, 8, 10])), between(0.14, 0.22))
        if kind in ("one ear", "two ears"):
            return eared(between(0.18, 0.24), 1 if kind == "one ear" else 2, between(0.44, 0.52))
        if kind == "spouted":
            return spouted(between(0.12, 0.18))
        return cut(int(rng.integers(6, 14))) if kind == "cut" else ROUND

    def radius(low: float, high: float, around: Outline) -> float:
        """Draw a radius, smaller for stretched outlines, so that they are not larger than round ones."""
        return round(rng.uniform(low, high) * (1 - 0.55 * around.stretch), 4)

    for i in range(count):
        around = outline("round", "oval", "polygon", "scalloped", "two ears", "spouted")
        bowl = (
            f"bowl-r{i}", "validation", radius(0.0605, 0.074, around), colour(), colour(), colour(), one_of(PATTERNS),
            between(0.46, 0.62), around,
        )  # fmt: skip
        around = outline("round", "oval", "polygon", "scalloped", "two ears")
        plate = (
            f"plate-r{i}", "validation", radius(0.068, 0.084, around), colour(value=(0.3, 0.97)), colour(),
            one_of(PATTERNS), between(0.58, 0.68), around,
        )  # fmt: skip
        kind = one_of(tuple(PIECES))
        slim = SLIM.get(kind, between(0.40, 0.74))
        metal = one_of((*METALS, colour()))
        piece = (
            f"piece-r{i}", "validation", between(0.162, 0.2, 3), kind, metal,
            colour() if rng.uniform(0, 1) < 0.5 else None, slim,
        )  # fmt: skip
        around = outline("round", "oval", "polygon", "one ear", "cut")
        narrow = rng.uniform(0, 1) < 0.15 and around is ROUND  # a wine glass
        mouth = between(0.62, 0.8) if narrow else 1.0
        glass = (
            f"glass-r{i}", "validation", radius(0.041, 0.0495, around), colour((0.02, 0.48), (0.62, 0.98)),
            between(0.14, 0.26), between(0.28, 0.4) if narrow else between(0.54, 0.74), between(0.05, 0.095, 3),
            around, mouth,
        )  # fmt: skip
        yield bowl, plate, piece, glass
