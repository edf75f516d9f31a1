"""Draw the unseen items and table tops of the sealed test at random, so that nobody chooses them.

Ours are the ranges and rules below, the names, and that one top is a veined stone. All else is random: colours,
patterns, outlines, sizes, and the kinds of the other tops. Radii stay within those of the training items, and stretched
outlines are up to a tenth longer. The first draws that keep the rules are taken. None was looked at before or replaced.
"""

import colorsys
from collections.abc import Iterator

import numpy as np

from making.data.kitchenware import GOLD, PIECES, STEEL, Colour
from making.data.shading import ROUND, Outline, cut, eared, oval, polygon, scalloped, spouted

Row = tuple  # a row of one of the tables in making.data.designs

SEED = 2136454221  # of every draw, from docs/expectations.csv (making.sealed)
ITEMS = 6  # of each symbol
MIN_COLOUR_GAP = 0.1  # least difference from each training colour, in its most different channel [1 = white]
MAX_TINT, MIN_NEUTRAL = 0.06, 0.5  # white and steel, which any item may share: channels alike, and not dark
MIN_OUTLINE_GAP = 0.05  # least difference from a circle as a share of the radius; facets of a cut glass differ by 0.03
SYMBOLS = ("bowl", "plate", "cutlery", "glass")  # in the order of a draw
TOPS = {"veins": "onyx", "checks": "gingham", "tiles": "tiles", "stripes": "ticking", "cracks": "crackle"}
# The patterns that resemble no training top, and the names of such tops.
TOP_PATTERNS = ("veins", "checks", "tiles", "stripes", "blotches", "chips", "cracks", "knots", "boards")  # of the draws
PATTERNS = ("plain", "band", "rings", "rays", "petals", "dots", "checks", "speckles", "glaze", "spiral")
METALS = STEEL, GOLD, (0.74, 0.48, 0.36), (0.62, 0.63, 0.66)  # RGB [1 = white]
SLIM = {"chopsticks": 0.86, "tongs": 0.95}  # fixed slimness of these kinds
SHARPNESS = {4: 3.3, 6: 16.0, 8: 120.0, 10: 140.0, 12: 160.0}  # sharpness of a polygon by its number of corners


def unseen_items(symbol: str, training: list[Row]) -> list[Row]:
    """Return rows of one of making.data.designs' tables that share no pattern, kind, colour or outline with `training`.

    Whites and steel may be shared. Pieces of cutlery are of different kinds.
    """
    shared_kind = {value for row in training for value in row if isinstance(value, str)}
    colours = np.array([colour for row in training for colour in _colours(row)])
    rows: list[Row] = []
    for items in _items(np.random.default_rng(SEED)):
        row = items[SYMBOLS.index(symbol)]
        kinds = {value for value in row if isinstance(value, str)}
        near = [np.abs(colours - colour).max(1).min() < MIN_COLOUR_GAP for colour in _colours(row)]
        if kinds & shared_kind or any(near) or not _is_unlike_a_circle(row):
            continue
        if symbol == "cutlery":
            shared_kind |= kinds
        rows.append((f"{symbol}-u{len(rows) + 1}", "unseen", *row))
        if len(rows) == ITEMS:
            break
    return rows


def _colours(row: Row) -> list[tuple]:
    """Return the colours of a row but white and steel."""
    colours = [value for value in row if isinstance(value, tuple)]
    return [c for c in colours if max(c) - min(c) > MAX_TINT or min(c) < MIN_NEUTRAL]


def _is_unlike_a_circle(row: Row) -> bool:
    """Return whether an outline is stretched, cornered or lobed, or a glass's mouth narrow; cutlery has no outline."""
    outline = next((value for value in row if isinstance(value, Outline)), None)
    if outline is None or outline.stretch:
        return True
    bearing = np.linspace(-np.pi, np.pi, 361)
    gap = np.abs(outline(np.cos(bearing), np.sin(bearing)) - 1).max()
    return gap > MIN_OUTLINE_GAP or (outline is ROUND and row[-1] != 1.0 and not isinstance(row[-1], Outline))


def unseen_tops() -> list[Row]:
    """Return three rows of making.data.designs' table of table tops: a veined stone and two more of TOPS."""
    stone, *others = TOPS
    kinds = {stone, *np.random.default_rng([SEED, 2]).choice(others, 2, replace=False).tolist()}
    rng, rows = np.random.default_rng([SEED, 1]), []
    for kind in TOP_PATTERNS:  # one of each is drawn
        hue, saturation, value = rng.uniform(0, 1), rng.uniform(0, 0.5), rng.uniform(0.25, 0.92)
        light = colorsys.hsv_to_rgb(hue, saturation, value)
        stain = rng.normal(0, 0.04), rng.uniform(0.8, 1.6), rng.uniform(0.55, 0.8)
        dark = colorsys.hsv_to_rgb((hue + stain[0]) % 1, min(1, saturation * stain[1]), value * stain[2])
        if kind in kinds:
            rows.append((TOPS[kind], "unseen", kind, light, dark))
    return rows


def _items(rng: np.random.Generator) -> Iterator[tuple[Row, Row, Row, Row]]:
    """Yield random items without end, one of each symbol: rows of the tables in making.data.designs, unnamed."""

    def between(low: float, high: float, digits: int = 2) -> float:
        return round(rng.uniform(low, high), digits)

    def colour(saturation: tuple[float, float] = (0.0, 0.85), value: tuple[float, float] = (0.15, 0.97)) -> Colour:
        return colorsys.hsv_to_rgb(rng.uniform(0, 1), rng.uniform(*saturation), rng.uniform(*value))

    def one_of(choices):
        return choices[rng.integers(len(choices))]

    def outline(*kinds: str) -> Outline:
        corners = (4, 6, 6, 8, 8, 10, 12)  # polygons of six and eight are twice as likely
        drawn = {
            "round": lambda: ROUND,
            "oval": lambda: oval(between(0.25, 0.65)),
            "polygon": lambda: polygon(sides := int(rng.choice(corners)), SHARPNESS[sides]),
            "scalloped": lambda: scalloped(int(rng.choice([4, 6, 8, 10])), between(0.14, 0.22)),
            "one ear": lambda: eared(between(0.18, 0.24), 1, between(0.44, 0.52)),
            "two ears": lambda: eared(between(0.18, 0.24), 2, between(0.44, 0.52)),
            "spouted": lambda: spouted(between(0.12, 0.18)),
            "cut": lambda: cut(int(rng.integers(6, 14))),
        }
        return drawn[one_of(kinds)]()

    def radius(low: float, high: float, around: Outline) -> float:
        """Draw a radius, smaller for stretched outlines, so that they are not larger than round ones."""
        return round(rng.uniform(low, high) * (1 - 0.55 * around.stretch), 4)

    while True:
        around = outline("round", "oval", "polygon", "scalloped", "two ears", "spouted")
        size = radius(0.0605, 0.074, around)
        bowl = size, colour(), colour(), colour(), one_of(PATTERNS), between(0.46, 0.62), around
        around = outline("round", "oval", "polygon", "scalloped", "two ears")
        size = radius(0.068, 0.084, around)
        plate = size, colour(value=(0.3, 0.97)), colour(), one_of(PATTERNS), between(0.58, 0.68), around
        kind = one_of(tuple(PIECES))
        slim = SLIM.get(kind, between(0.40, 0.74))
        metal = one_of((*METALS, colour()))
        piece = between(0.162, 0.2, 3), kind, metal, colour() if rng.uniform(0, 1) < 0.5 else None, slim
        around = outline("round", "oval", "polygon", "one ear", "cut")
        narrow = rng.uniform(0, 1) < 0.15 and around is ROUND  # a wine glass
        mouth = between(0.62, 0.8) if narrow else 1.0
        size, tint = radius(0.041, 0.0495, around), colour((0.02, 0.48), (0.62, 0.98))
        body, foot = between(0.14, 0.26), between(0.28, 0.4) if narrow else between(0.54, 0.74)
        glass = size, tint, body, foot, between(0.05, 0.095, 3), around, mouth
        yield bowl, plate, piece, glass
