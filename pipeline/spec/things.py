"""Things on a table, found in its picture without labels: whatever stands out from the table, each as a capsule.

Nothing here is learned, and nothing knows a symbol: a thing is a region whose colour differs from the table's by more
than the table itself varies. A capsule (the points within `radius` of a segment) is how robots commonly bound things.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from numpy import ndarray as Array
from scipy import ndimage
from torch import Tensor

from pipeline.spec.reward import against_table

FEATURES = ("area", "elongation", "contrast", "plain contrast")  # logarithms all
SIDE = 100  # pixels along an edge of a picture of the 1 m table
MOST = 12  # things kept of a scene, the largest
BLOCK, WINDOW = (
    4,
    9,
)  # pixels, blocks: the table's drift is the median of medians over 36 x 36 pixels, wider than things
NARROW, WIDE = (1, 2, 1), (1, 4, 6, 4, 1)  # smoothing kernels
DARKER = 0.4  # what a darkening without a change of colour counts: things cast shadows beside them
TABLE = 3.2  # deviations [standard deviations] above which a pixel says nothing of how much the table varies
FAINTEST = 0.002  # smallest spread of the table's colour [1 = white]
REGION, PEAK = 4.5, 6.0  # deviations that every pixel of a thing, and one at least, exceed
SMALLEST = 12  # pixels; smaller regions belong to the table
OUTLINE, RIM = 0.5, 3  # a thing ends where its contrast falls to this share of what it has in its outermost pixels
FINER = 4  # outlines are drawn on a grid that many times finer
AT_LEAST = 2.7  # deviations on a thing's outline


@dataclass(frozen=True)
class Things:
    """Things by scene, padded to MOST."""

    ends: Float32[Array, "scene thing 2 2"]  # of each capsule's segment [m]
    radius: Float32[Array, "scene thing"]  # [m]
    features: Float32[Array, "scene thing feature"]
    present: Bool[Array, "scene thing"]


def find(images: Float[Tensor, "scene 3 100 100"]) -> Things:
    """The things in each picture, each picture by itself."""
    pixels = images.detach().permute(0, 2, 3, 1).mul(255).round().to(torch.uint8).contiguous().numpy()
    things = Things(
        np.zeros((len(pixels), MOST, 2, 2), np.float32),
        np.zeros((len(pixels), MOST), np.float32),
        np.zeros((len(pixels), MOST, len(FEATURES)), np.float32),
        np.zeros((len(pixels), MOST), bool),
    )
    for scene, picture in enumerate(pixels):
        for i, (ends, radius, features) in enumerate(_found(picture.tobytes())):
            things.ends[scene, i], things.radius[scene, i] = ends, radius
            things.features[scene, i], things.present[scene, i] = features, True
    return things


@lru_cache(maxsize=2048)  # every model looks at the same pictures
def _found(picture: bytes) -> list[tuple[Array, float, Array]]:
    """Ends [m], radius [m] and features of the MOST largest things in an 8-bit picture, the largest first."""
    pixels = np.frombuffer(picture, np.uint8).reshape(SIDE, SIDE, 3)
    image = pixels.transpose(2, 0, 1) / np.float32(255)
    standing_out, edge, plain = contrasts(image)
    found = []
    for mask, corner in _outlines(standing_out, edge):
        rows, columns = np.nonzero(mask)
        y, x = corner[0] + (rows + 0.5) / FINER, corner[1] + (columns + 0.5) / FINER
        centre, along, radius, area, elongation = capsule(np.stack([x, SIDE - y], -1) / SIDE)
        inside = y.astype(int), x.astype(int)
        features = np.log([area, elongation, edge[inside].mean(), plain[inside].mean()])
        found.append((np.stack([centre - along, centre + along]), radius, features))
    return sorted(found, key=lambda thing: -thing[2][0])[:MOST]


def contrasts(
    image: Float32[Array, "3 row column"],
) -> tuple[Float[Array, "row column"], Float[Array, "row column"], Float[Array, "row column"]]:
    """How far each pixel is from the table: widely smoothed to find things, narrowly to outline them, and plain.

    The first two are in standard deviations of the table's own variation, the last in [1 = white].
    """
    difference = against_table(torch.from_numpy(image)[None])[0][0].numpy()
    difference = difference - _drift(difference)
    wide, narrow = _smooth(difference, WIDE), _smooth(difference, NARROW)
    table = np.median(image.reshape(3, -1), axis=1)
    table = table / np.linalg.norm(table)
    darkening = np.minimum(np.tensordot(table, narrow, 1), 0)
    lit = narrow - (1 - DARKER) * table[:, None, None] * darkening
    deviations = np.linalg.norm(_whitening(wide) @ wide.reshape(3, -1), axis=0).reshape(wide.shape[1:])
    of_edges = np.linalg.norm(_whitening(narrow) @ lit.reshape(3, -1), axis=0).reshape(wide.shape[1:])
    return deviations, of_edges, np.linalg.norm(narrow, axis=0)


def _drift(difference: Array) -> Array:
    """How the table changes from place to place: boards, blotches, folds."""
    blocks = difference.reshape(3, SIDE // BLOCK, BLOCK, SIDE // BLOCK, BLOCK).swapaxes(2, 3)
    coarse = np.median(blocks.reshape(*blocks.shape[:3], -1), axis=-1)
    coarse = ndimage.median_filter(coarse, (1, WINDOW, WINDOW), mode="reflect")
    return ndimage.zoom(coarse, (1, BLOCK, BLOCK), order=1, grid_mode=True, mode="nearest")


def _smooth(difference: Array, kernel: tuple[int, ...]) -> Array:
    taps = np.array(kernel) / sum(kernel)
    for axis in (1, 2):
        difference = ndimage.convolve1d(difference, taps, axis=axis, mode="nearest")
    return difference


def _whitening(difference: Float[Array, "3 row column"]) -> Float[Array, "3 3"]:
    """What makes the table's variation 1 in every direction of colour, judged by the pixels of the table alone."""
    colours = difference.reshape(3, -1).T
    table = np.ones(len(colours), bool)
    whitening = np.eye(3)
    for _ in range(4):
        covariance = colours[table].T @ colours[table] / table.sum() + FAINTEST**2 * np.eye(3)
        values, vectors = np.linalg.eigh(covariance)
        whitening = vectors / np.sqrt(values) @ vectors.T
        table = np.linalg.norm(colours @ whitening, axis=1) < TABLE
    return whitening


def _outlines(standing_out: Array, edge: Array) -> list[tuple[Bool[Array, "row column"], tuple[int, int]]]:
    """Each thing's mask on the finer grid, holes filled, and the row and column of the mask's corner."""
    labels, _ = ndimage.label(standing_out > REGION, np.ones((3, 3)))
    outlines = []
    for label, place in enumerate(ndimage.find_objects(labels), 1):
        region = labels[place] == label
        if region.sum() < SMALLEST or standing_out[place][region].max() < PEAK:
            continue
        corner = tuple(max(s.start - RIM, 0) for s in place)
        window = tuple(slice(c, min(s.stop + RIM, SIDE)) for c, s in zip(corner, place, strict=True))
        region = labels[window] == label
        rim = region & ~ndimage.binary_erosion(region, iterations=RIM)
        level = np.quantile(edge[window][rim], 0.7)
        around = np.where(ndimage.binary_dilation(region, np.ones((3, 3)), iterations=2), edge[window], 0)
        finer = ndimage.zoom(around, FINER, order=1, grid_mode=True, mode="nearest")
        mask = ndimage.binary_fill_holes(finer > max(OUTLINE * level, AT_LEAST))
        pieces, count = ndimage.label(mask)
        for piece in range(1, count + 1):
            if (pieces == piece).sum() >= SMALLEST * FINER**2:
                outlines.append((pieces == piece, corner))
    return outlines


_LENGTHS = np.linspace(0, 20, 2001)  # half-lengths of capsules of radius 1 ...
_ELONGATIONS = (4 / 3 * _LENGTHS**3 + np.pi * _LENGTHS**2 + 8 / 3 * _LENGTHS + np.pi / 4) / (
    4 / 3 * _LENGTHS + np.pi / 4
)  # ... and the ratio of their variances, along to across


def capsule(
    points: Float[Array, "point 2"],
) -> tuple[Float[Array, "2"], Float[Array, "2"], float, float, float]:
    """The capsule of the same area and moments as evenly spaced points [m], FINER * SIDE of them to the metre.

    Centre and half of the segment [m], radius [m], area [m^2], and the variance along it over that across it.
    """
    centre = points.mean(0)
    values, vectors = np.linalg.eigh((points - centre).T @ (points - centre) / len(points))
    elongation = float(values[1] / values[0])
    length = float(np.interp(elongation, _ELONGATIONS, _LENGTHS))
    area = len(points) / (FINER * SIDE) ** 2
    radius = float(np.sqrt(area / (np.pi + 4 * length)))
    return centre, length * radius * vectors[:, 1], radius, area, elongation
