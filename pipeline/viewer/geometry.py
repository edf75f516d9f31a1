"""Convert metres to the coordinates of the views, and compute the outlines drawn in them.

On the table a unit is a pixel of the image (1 cm); on a map over z_theta a unit is a cell. Both have their origin in
the far left corner, with y towards the viewer, as in images. On a board a unit is a pixel.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray as Array

from pipeline.world.bezier import Z_HIGH, Z_LOW
from pipeline.world.layout import SYMBOLS, Layouts

TABLE_PIXELS = 100  # side of a scene's image [px]; the table is 1 m wide
PITCH = 112.0  # distance between panels of a board [px]
ARC_POINTS = 16  # points on each round end of a footprint


def on_table(points: Float[Array, "*b 2"]) -> Float[Array, "*b 2"]:
    """Return points [m] in pixels of the scene's image."""
    return np.stack([points[..., 0], 1.0 - points[..., 1]], axis=-1) * TABLE_PIXELS


def on_map(z_theta: Float[Array, "*b 2"], side: int) -> Float[Array, "*b 2"]:
    """Return control points [m] in cells of a map of `side` x `side`."""
    cell = (Z_HIGH - Z_LOW) / side
    return np.stack([z_theta[..., 0] - Z_LOW, Z_HIGH - z_theta[..., 1]], axis=-1) / cell


def corner(row: int, column: int) -> Float[Array, "2"]:
    """Return the far left corner of a board's panel."""
    return PITCH * np.array([column, row], dtype=float)


def map_image(values: Array) -> Array:
    """Return values [y, x] on `bezier.lattice` as an image, with the largest y in row 0."""
    return np.ascontiguousarray(values[::-1])


def footprints(layout: Layouts) -> list[tuple[str, Float[Array, "point 2"]]]:
    """Return the symbol and the closed outline [m] of every item of the one scene in `layout`."""
    return kept_clear(layout, dict.fromkeys(SYMBOLS, 0.0))


def kept_clear(layout: Layouts, margins: Mapping[str, float | None]) -> list[tuple[str, Float[Array, "point 2"]]]:
    """Return the same outlines enlarged by the user's margin, for items with a margin."""
    half_turn = np.linspace(0.5 * np.pi, 1.5 * np.pi, ARC_POINTS)
    outlines = []
    for slot in np.flatnonzero(layout.present[0]):
        symbol = SYMBOLS[layout.symbol[0, slot]]
        margin = margins[symbol]
        if margin is None:
            continue
        around = np.concatenate([half_turn, half_turn + np.pi, half_turn[:1]]) + layout.angle[0, slot]
        centres = np.repeat(layout.ends[0, slot], ARC_POINTS, axis=0)  # (2 * ARC_POINTS, 2)
        centres = np.concatenate([centres, centres[:1]])
        ring = np.stack([np.cos(around), np.sin(around)], axis=-1)
        outlines.append((symbol, centres + (layout.radius[0, slot] + margin) * ring))
    return outlines


def boundary(truth: Bool[Array, "side side"]) -> Float[Array, "edge 2 2"]:
    """Return the edges between valid and invalid cells of a map [y, x], in the coordinates of `on_map`."""
    image = map_image(truth)
    row, column = np.nonzero(image[:, 1:] != image[:, :-1])
    upright = np.stack([np.stack([column + 1, row], -1), np.stack([column + 1, row + 1], -1)], axis=1)
    row, column = np.nonzero(image[1:] != image[:-1])
    level = np.stack([np.stack([column, row + 1], -1), np.stack([column + 1, row + 1], -1)], axis=1)
    return np.concatenate([upright, level]).astype(float)
