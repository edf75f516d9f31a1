"""A table top: one family's, sometimes with others laid on it or mixed in, sometimes worn."""

from collections.abc import Sequence

import cv2
import numpy as np

from making.segmenter.paint import FRACTION_BITS, Field, Top, noise, points
from making.segmenter.tops import FAMILIES
from making.segmenter.tops.wear import worn


def draw_top(rng: np.random.Generator, families: Sequence[str], side: int) -> tuple[str, Top]:
    """Draw a top of one family, sometimes with others' laid on it or mixed in; return the first one's name too."""
    name = str(rng.choice(families))
    top = FAMILIES[name].draw(rng, side).astype(np.float32)
    while rng.random() < 0.22:
        other = FAMILIES[str(rng.choice(families))].draw(rng, side).astype(np.float32)
        if rng.random() < 0.4:
            top = top * (
                1 + (other.mean(2, keepdims=True) / max(float(other.mean()), 0.05) - 1) * rng.uniform(0.1, 0.6)
            )
        else:
            top += (other - top) * patch(rng, side)[..., None]
    if rng.random() < 0.3:
        top = worn(rng, top)
    return name, np.clip(top, 0.005, 1.2).astype(np.float32)


def patch(rng: np.random.Generator, side: int) -> Field:
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
