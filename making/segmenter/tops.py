"""A table top: one family's, sometimes with others laid on it or mixed in, and with marks of use: all of them table."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import cv2
import numpy as np

from making.segmenter.families import HELD_OUT, TAUGHT
from making.segmenter.paint import FRACTION_BITS, Colour, Field, Rng, Top, colour, noise, points, step

Kind = Literal["taught", "held_out"]


class Family(NamedTuple):
    """A kind of table top."""

    draw: Callable[[Rng, int], Top]  # draws a top of so many pixels a side
    kind: Kind


FAMILIES: dict[str, Family] = {draw.__name__: Family(draw, "taught") for draw in TAUGHT}
FAMILIES |= {draw.__name__: Family(draw, "held_out") for draw in HELD_OUT}


def family_names(kind: Kind) -> list[str]:
    """Return the names of the families of one kind."""
    return [name for name, family in FAMILIES.items() if family.kind == kind]


def draw_top(rng: Rng, families: Sequence[str], side: int) -> tuple[str, Top]:
    """Draw a top of one family, sometimes with others' laid on it or mixed in; return the first one's name too."""
    name = str(rng.choice(families))
    top = FAMILIES[name].draw(rng, side).astype(np.float32)
    while rng.random() < 0.22:
        other = FAMILIES[str(rng.choice(families))].draw(rng, side).astype(np.float32)
        if rng.random() < 0.4:
            relief = other.mean(2, keepdims=True) / max(float(other.mean()), 0.05) - 1
            top = top * (1 + relief * rng.uniform(0.1, 0.6))
        else:
            top += (other - top) * patch(rng, side)[..., None]
    if rng.random() < 0.3:
        top = worn(rng, top)
    return name, np.clip(top, 0.005, 1.2).astype(np.float32)


def patch(rng: Rng, side: int) -> Field:
    """Return the share of another material: a runner, a place-mat, a round cloth, an edge or blots."""
    mask = np.zeros((side, side), np.uint8)
    kind, centre = rng.integers(5), rng.uniform(0.1, 0.9, 2) * side
    half = np.array([[2, rng.uniform(0.1, 0.3)], rng.uniform(0.13, 0.4, 2), [0.9, 0.9]][min(kind, 2)]) * side
    if kind == 3:
        radius = int(points(rng.uniform(0.15, 0.5) * side))
        cv2.circle(mask, points(centre).tolist(), radius, 255, -1, cv2.LINE_AA, FRACTION_BITS)
    elif kind == 4:
        return np.clip((noise(rng, side, rng.uniform(2, 5), 3) - rng.uniform(0, 1)) / 0.1, 0, 1)
    else:
        if kind == 2:
            centre = centre + half * rng.choice([-1, 1], 2)
        box = cv2.boxPoints((centre.tolist(), (2 * half).tolist(), rng.uniform(0, 180)))
        cv2.fillConvexPoly(mask, points(box), 255, cv2.LINE_AA, FRACTION_BITS)
    return mask.astype(np.float32) / 255


def worn(rng: Rng, top: Top) -> Top:
    """Return a top with some marks of use."""
    side = len(top)
    marks = [stains, cup_rings, crumbs, scratches]
    for k in rng.permutation(len(marks))[: rng.integers(1, 3)]:
        share, shade = marks[k](rng, side)
        top = top + (shade - top) * (share * np.float32(rng.uniform(0.1, 0.7)))[..., None]
    return top


def stains(rng: Rng, side: int) -> tuple[Field, Colour]:
    """Return the share of each pixel that blots cover, and their colour."""
    field = noise(rng, side, rng.uniform(2, 8), 3)
    least = rng.uniform(1, 2.2)
    edge = np.exp(-(((field - least) / 0.15) ** 2)) if rng.random() < 0.4 else 0
    return np.clip(0.6 * step(field - least, 0.2) + edge, 0, 1), colour(rng, (0, 0.15), (0, 0.7), (0.05, 0.6))


def cup_rings(rng: Rng, side: int) -> tuple[Field, Colour]:
    """Return the share of each pixel that rings of wet cups cover, and their colour."""
    mask = np.zeros((side, side), np.uint8)
    for _ in range(rng.integers(1, 5)):
        radius = int(points(side * rng.uniform(0.02, 0.045)))
        start = rng.uniform(0, 360)
        arc = points(rng.uniform(0, side, 2)).tolist(), [radius, radius], 0, start, start + rng.uniform(120, 360)
        cv2.ellipse(mask, *arc, 255, int(rng.integers(1, 3)), cv2.LINE_AA, FRACTION_BITS)
    faded = mask / np.float32(255) * np.clip(0.6 + 0.4 * noise(rng, side, 20), 0, 1)
    return faded, colour(rng, (0, 0.12), (0, 0.7), (0.05, 0.95))


def crumbs(rng: Rng, side: int) -> tuple[Field, Colour]:
    """Return the share of each pixel that crumbs, drops or chips cover, and their colour."""
    mask = np.zeros((side, side), np.uint8)
    middle, spread = rng.uniform(0, side, 2), side * rng.uniform(0.05, 0.5)
    for place in rng.normal(middle, spread, (rng.integers(3, 60), 2)):
        axes = points(side * rng.uniform(0.0015, 0.008, 2)).tolist()
        crumb = points(place).tolist(), axes, rng.uniform(0, 180), 0, 360
        cv2.ellipse(mask, *crumb, 255, -1, cv2.LINE_AA, FRACTION_BITS)
    return mask / np.float32(255), colour(rng)


def scratches(rng: Rng, side: int) -> tuple[Field, Colour]:
    """Return the share of each pixel that scratches or hairs cover, and their colour."""
    mask = np.zeros((side, side), np.uint8)
    for _ in range(rng.integers(1, 25)):
        curve = rng.uniform(0, side, 2) + rng.normal(0, side * rng.uniform(0.005, 0.06), (5, 2)).cumsum(0)
        cv2.polylines(mask, [points(curve)], False, 255, 1, cv2.LINE_AA, FRACTION_BITS)
    return mask / np.float32(255), colour(rng)
