"""Things on a table, found in its picture without labels: whatever stands out from the table, each as a capsule.

Nothing here is learned, and nothing knows a symbol: a thing is a region whose colour differs from the table's by more
than the table itself varies. What is large stands out from a table smoothed widely; what is left is searched for thin
outlines, such as a clear glass's rim, which stand out from the table close by. Where several of what is found are faint
specks, they are the table's own pattern (chips, knots, veins) and dropped. Dropped, too, is what has no order: its
neighbouring pixels differ about as much as any two of its pixels do. A capsule (the points within `radius` of a
segment) is how robots commonly bound things.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32
from numpy import ndarray as Array
from scipy import ndimage
from scipy.spatial import ConvexHull
from torch import Tensor

from pipeline.models.base import to_bytes
from pipeline.perception.background import subtract_background
from pipeline.world.layout import SIDE

FEATURES = ("area", "elongation", "length", "width", "contrast", "plain contrast")  # logarithms all
MOST = 12  # things kept of a scene, the largest
WIDELY = 4, 9  # pixels, blocks: the table's drift is the median of medians over 36 x 36 pixels, wider than things ...
CLOSELY = 2, 3  # ... or over 6 x 6, which takes mottles off and leaves lines one or two pixels wide
NARROW, WIDE = (1, 2, 1), (1, 4, 6, 4, 1)  # smoothing kernels
DARKER = 0.4  # what a darkening without a change of colour counts: things cast shadows beside them
TABLE = 3.2  # deviations [standard deviations] above which a pixel says nothing of how much the table varies
FAINTEST = 0.002  # smallest spread of the table's colour [1 = white]
REGION, PEAK = 4.5, 6.0  # deviations that every pixel of a thing, and one at least, exceed
LINE = 3.0  # deviations that every pixel of a thin outline exceeds, one again PEAK
AROUND = 2  # pixels around a thing that belong to it
NECK = 5.0  # pixels; wide parts joined by less are things of their own
SMALLEST = 12  # pixels; smaller regions belong to the table
OUTLINE, RIM = 0.5, 3  # a thing ends where its contrast falls to this share of what it has in its outermost pixels ...
NEARBY = 7  # ... or of the most it has in a square of that many pixels around, if that is less: a handle is no blade
FINER = 4  # outlines are drawn on a grid that many times finer
AT_LEAST = 2.7  # deviations on a thing's outline
FAINT = 2.6  # deviations on average: a long thing that differs less is the table's grain, such as the edge of a board
LONG = 2.5  # variance along a thing over that across it from which its ends count, and not its moments alone
SPECK, COMPACT = 0.003, 4.0  # [m^2], variance along over across: what is faint, smaller and rounder is a speck ...
FIT = 0.65  # ... and so is what is faint and shares less than this with its capsule (intersection over union)
SPECKS = 3  # so many of them belong to the table's pattern: chips, knots, pieces of veins
CROSS = np.array([[[0, 1, 0], [1, 0, 1], [0, 1, 0]]]) / 4  # means over a pixel's four neighbours
DISORDER = 0.75  # share of a thing's variance by which its pixels miss their neighbours' mean; shuffled ones: to 1.25
WIDER = 0.5  # pixels that a long thing's radius is widened by: its outline lies that much further in than a round one's

Deviations = Float[Array, "row column"]  # from the table [standard deviations of its own variation]
Difference = Float[Array, "3 row column"]  # of colour [1 = white]
Mask = Bool[Array, "row column"]
FineMask = Bool[Array, "fine_row fine_column"]  # on the grid of outlines


@dataclass(frozen=True)
class Things:
    """Things by scene, padded to MOST."""

    ends: Float32[Array, "scene thing 2 2"]  # of each capsule's segment [m]
    radius: Float32[Array, "scene thing"]  # [m]
    features: Float32[Array, "scene thing feature"]
    present: Bool[Array, "scene thing"]


def find(images: Float[Tensor, "scene 3 100 100"]) -> Things:
    """The things in each picture, each picture by itself."""
    things = Things(
        np.zeros((len(images), MOST, 2, 2), np.float32),
        np.zeros((len(images), MOST), np.float32),
        np.zeros((len(images), MOST, len(FEATURES)), np.float32),
        np.zeros((len(images), MOST), bool),
    )
    for scene, picture in enumerate(to_bytes(images)):
        for i, thing in enumerate(_found(picture)):
            things.ends[scene, i], things.radius[scene, i] = thing.ends, thing.radius
            things.features[scene, i], things.present[scene, i] = thing.features, True
    return things


class _Thing(NamedTuple):
    ends: Float[Array, "2 2"]  # of the capsule's segment [m]
    radius: float  # [m]
    features: Float[Array, " feature"]
    fit: float  # intersection of the thing and its capsule over their union
    disorder: float  # how far its pixels, a rim included, are from their neighbours' mean: square over their variance


@lru_cache(maxsize=4096)  # of 30 kB each; every model looks at the same pictures
def _found(picture: bytes) -> list[_Thing]:
    """The MOST largest things in an 8-bit picture, the largest first."""
    pixels = np.frombuffer(picture, np.uint8).reshape(SIDE, SIDE, 3)
    image = pixels.transpose(2, 0, 1) / np.float32(255)
    standing_out, edge, lines, plain, colours = contrasts(image)
    apart = _apart(colours)
    regions = _regions(standing_out, REGION)
    rest = np.where(_around(np.any([np.zeros((SIDE, SIDE), bool), *regions], axis=0)), 0, lines)
    large = chain.from_iterable(_outlines(region, edge) for region in regions)
    thin = chain.from_iterable(_outlines(region, lines, thin=True) for region in _regions(rest, LINE))
    found = []
    for mask, corner in chain(large, thin):
        rows, columns = np.nonzero(mask)
        y, x = corner[0] + (rows + 0.5) / FINER, corner[1] + (columns + 0.5) / FINER
        points = np.stack([x, SIDE - y], -1) / SIDE
        centre, along, radius, area, elongation = capsule(points)
        inside = y.astype(int), x.astype(int)
        contrast = edge[inside].mean()
        if elongation > LONG:
            radius += WIDER / SIDE
            if contrast < FAINT:
                continue
        length, width = 2 * (np.linalg.norm(along) + radius), 2 * radius
        features = np.log(np.array([area, elongation, length, width, contrast, plain[inside].mean()]))
        fit = _fit(points - centre, along, radius)
        here = np.zeros((SIDE, SIDE), bool)
        here[inside] = True
        here = ndimage.binary_dilation(here, np.ones((3, 3)))
        disorder = apart[here].mean() / colours[:, here].var(1).sum()
        found.append(_Thing(np.stack([centre - along, centre + along]), radius, features, fit, disorder))
    ordered = [thing for thing in _off_pattern(found) if not thing.disorder >= DISORDER]
    return sorted(ordered, key=lambda thing: -thing.features[0])[:MOST]


def _off_pattern(found: list[_Thing]) -> list[_Thing]:
    """All but specks, where there are SPECKS or more: the table's own pattern. Fewer may be things, and stay."""
    features = np.exp(np.reshape([thing.features for thing in found], (-1, len(FEATURES))))
    area, elongation, contrast = (features[:, FEATURES.index(name)] for name in ("area", "elongation", "contrast"))
    no_capsules = np.array([thing.fit for thing in found]) < FIT
    specks = ((area < SPECK) & (elongation < COMPACT) | no_capsules) & (contrast < PEAK)
    if specks.sum() < SPECKS:
        return found
    return [thing for thing, speck in zip(found, specks, strict=True) if not speck]


def layers(image: Float32[Array, "3 row column"]) -> tuple[Difference, Difference, Difference, Difference]:
    """How colours differ from the table's: smoothed widely and narrowly, what is thin in the latter, what is finer."""
    difference = subtract_background(torch.from_numpy(image)[None])[0][0].numpy()
    difference = difference - _drift(difference, *WIDELY)
    wide, narrow = _smooth(difference, WIDE), _smooth(difference, NARROW)
    return wide, narrow, narrow - _drift(narrow, *CLOSELY), difference - narrow


def contrasts(
    image: Float32[Array, "3 row column"],
) -> tuple[Deviations, Deviations, Deviations, Float[Array, "row column"], Difference]:
    """How far each pixel is from the table: smoothed to find things, less so to outline them, of thin lines, and plain;
    and its colour's difference, not smoothed.

    All are in standard deviations of the table's own variation, but for the plain one, in [1 = white].
    """
    wide, narrow, thin, finer = layers(image)
    table = np.median(image.reshape(3, -1), axis=1)
    table = table / np.linalg.norm(table)
    darkening = np.minimum(np.tensordot(table, narrow, 1), 0)
    lit = narrow - (1 - DARKER) * table[:, None, None] * darkening
    plain = np.linalg.norm(narrow, axis=0)
    white = whitening(narrow)
    edge, colours = _deviations(lit, white), np.tensordot(white, narrow + finer, 1)
    return _deviations(wide, whitening(wide)), edge, _deviations(thin, whitening(thin)), plain, colours


def _apart(colours: Difference) -> Float[Array, "row column"]:
    """Each pixel's squared distance from its neighbours' mean, less what the table itself has: noise is no disorder."""
    apart = ((colours - ndimage.convolve(colours, CROSS, mode="nearest")) ** 2).sum(0)
    return apart - np.median(apart)


def _deviations(difference: Difference, white: Float[Array, "3 3"]) -> Deviations:
    """Mahalanobis distance of each pixel's difference from 0, under the variation that is 1 once whitened."""
    return np.linalg.norm(np.tensordot(white, difference, 1), axis=0)


def _drift(difference: Float[Array, "3 row column"], block: int, window: int) -> Float[Array, "3 row column"]:
    """How the table changes from place to place (boards, blotches, folds): medians over `window` by `window` blocks of
    `block` by `block` pixels. What it does at the picture's edges it goes on doing beyond them.
    """
    blocks = difference.reshape(3, SIDE // block, block, SIDE // block, block).swapaxes(2, 3)
    coarse = np.median(blocks.reshape(*blocks.shape[:3], -1), axis=-1)
    beyond = window // 2
    coarse = np.pad(coarse, ((0, 0), (beyond, beyond), (beyond, beyond)), mode="reflect", reflect_type="odd")
    coarse = ndimage.median_filter(coarse, (1, window, window))[:, beyond:-beyond, beyond:-beyond]
    return ndimage.zoom(coarse, (1, block, block), order=1, grid_mode=True, mode="nearest")


def _smooth(difference: Float[Array, "3 row column"], kernel: tuple[int, ...]) -> Float[Array, "3 row column"]:
    taps = np.array(kernel) / sum(kernel)
    for axis in (1, 2):
        difference = ndimage.convolve1d(difference, taps, axis=axis, mode="nearest")
    return difference


def whitening(difference: Difference) -> Float[Array, "3 3"]:
    """What makes the table's variation 1 in every direction of colour, judged by the pixels of the table alone."""
    colours = difference.reshape(3, -1)
    table = np.ones(colours.shape[1], bool)
    found = np.eye(3)
    for _ in range(4):
        covariance = (colours * table) @ colours.T / table.sum() + FAINTEST**2 * np.eye(3)
        values, vectors = np.linalg.eigh(covariance)
        found = vectors / np.sqrt(values) @ vectors.T
        table = ((found @ colours) ** 2).sum(0) < TABLE**2
    return found


def _regions(deviations: Deviations, least: float) -> list[Mask]:
    """Connected pixels that all exceed `least`, one at least PEAK, and what they enclose."""
    labels, count = ndimage.label(deviations > least, np.ones((3, 3)))
    regions = (labels == label for label in range(1, count + 1))
    return [ndimage.binary_fill_holes(r) for r in regions if r.sum() >= SMALLEST and deviations[r].max() >= PEAK]


def _around(mask: Mask) -> Mask:
    return ndimage.binary_dilation(mask, np.ones((3, 3)), iterations=AROUND)


def _outlines(region: Mask, edge: Deviations, thin: bool = False) -> list[tuple[FineMask, tuple[int, int]]]:
    """The mask on the finer grid of each thing in a region, holes filled, and the row and column of its corner.

    A `thin` outline that encloses nothing is broken: all within its convex hull belongs to the thing.
    """
    ((rows, columns),) = ndimage.find_objects(region.astype(int))
    corner = max(rows.start - RIM, 0), max(columns.start - RIM, 0)
    window = slice(corner[0], rows.stop + RIM), slice(corner[1], columns.stop + RIM)
    region, edge = region[window], edge[window]
    rim = region & ~ndimage.binary_erosion(region, iterations=RIM)
    level = np.minimum(np.quantile(edge[rim], 0.7), ndimage.maximum_filter(np.where(region, edge, 0), NEARBY))
    outside = _finer(np.where(_around(region), edge, 0)) <= np.maximum(OUTLINE * _finer(level), AT_LEAST)
    pieces, count = ndimage.label(ndimage.binary_fill_holes(~outside))
    parts = []
    for mask in (pieces == piece for piece in range(1, count + 1)):
        broken = thin and (mask & outside).sum() < SMALLEST * FINER**2
        parts += [_hull(mask)] if broken else _parts(mask)
    return [(part, corner) for part in parts if part.sum() >= SMALLEST * FINER**2]


def _finer(values: Float[Array, "row column"]) -> Float[Array, "fine_row fine_column"]:
    return ndimage.zoom(values, FINER, order=1, grid_mode=True, mode="nearest")


def _parts(mask: FineMask) -> list[FineMask]:
    """A mask cut at its necks: each pixel goes with the nearest of the wide parts, deeper than half a NECK."""
    depth = ndimage.distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    wide, count = ndimage.label(depth > NECK / 2 * FINER)
    if count < 2:
        return [mask]
    nearest = ndimage.distance_transform_edt(wide == 0, return_distances=False, return_indices=True)
    return [mask & (wide[tuple(nearest)] == part) for part in range(1, count + 1)]


def _hull(mask: FineMask) -> FineMask:
    """Every pixel within the convex hull of a mask's pixels."""
    corners = (np.argwhere(mask)[:, None] + np.argwhere(np.ones((2, 2)))).reshape(-1, 2)  # of pixels: never in line
    row, column = np.ogrid[: mask.shape[0], : mask.shape[1]]
    within = np.ones_like(mask)
    for down, across, offset in ConvexHull(corners).equations:
        within &= down * (row + 0.5) + across * (column + 0.5) + offset <= 1e-9
    return within


_LENGTHS = np.linspace(0, 20, 2001)  # half-lengths of capsules of radius 1 ...
_ELONGATIONS = (4 / 3 * _LENGTHS**3 + np.pi * _LENGTHS**2 + 8 / 3 * _LENGTHS + np.pi / 4) / (
    4 / 3 * _LENGTHS + np.pi / 4
)  # ... and the ratio of their variances, along to across


def capsule(
    points: Float[Array, "point 2"],
) -> tuple[Float[Array, "2"], Float[Array, "2"], float, float, float]:
    """The capsule of the same area and moments as evenly spaced points [m], FINER * SIDE of them to the metre.

    What is LONG gets its length from its ends, for most pieces of cutlery are no capsules: moments make them short.
    Centre and half of the segment [m], radius [m], area [m^2], and the variance along it over that across it.
    """
    centre = points.mean(0)
    values, vectors = np.linalg.eigh((points - centre).T @ (points - centre) / len(points))
    elongation, axis = float(values[1] / values[0]), vectors[:, 1]
    area = len(points) / (FINER * SIDE) ** 2
    if elongation <= LONG:
        length = np.interp(elongation, _ELONGATIONS, _LENGTHS)
        radius = np.sqrt(area / (np.pi + 4 * length))
        return centre, length * radius * axis, float(radius), area, elongation
    along = (points - centre) @ axis
    extent = max(np.ptp(along) + 1 / (FINER * SIDE), 2 * np.sqrt(area / np.pi))
    radius = (extent - np.sqrt(extent**2 - (4 - np.pi) * area)) / (4 - np.pi)
    middle = centre + (along.min() + along.max()) / 2 * axis
    return middle, (extent / 2 - radius) * axis, float(radius), area, elongation


def _fit(points: Float[Array, "point 2"], along: Float[Array, "2"], radius: float) -> float:
    """Intersection over union of evenly spaced points [m], FINER * SIDE to the metre, and a capsule around 0."""
    share = np.clip(points @ along / max(along @ along, 1e-12), -1, 1)
    inside = np.linalg.norm(points - share[:, None] * along, axis=1) <= radius
    both = inside.sum() / (FINER * SIDE) ** 2
    either = len(points) / (FINER * SIDE) ** 2 + np.pi * radius**2 + 4 * radius * np.linalg.norm(along) - both
    return float(both / either)
