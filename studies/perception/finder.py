"""The baseline: the hand-tuned finder of the first edition, which detects objects without any training.

An object is a region whose colour differs from the table's by more than the table's own variation. Five steps:
1. subtract the background: the table's colour, which is smooth over the image, and its drift from board to board;
2. whiten: scale the difference by the standard deviation of the table's variation (unit "deviations");
3. segment: connected pixels that deviate, first large regions, then thin outlines such as a clear glass's rim;
4. refine each outline on a finer grid, and cut it at its necks;
5. fit a capsule, and reject regions that belong to the table's own pattern.
"""

from functools import lru_cache
from typing import NamedTuple

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8
from numpy import ndarray as Array
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from pipeline.perception.background import subtract_background
from pipeline.perception.capsule import MIN_LONG_ELONGATION, Capsule, fit_capsule
from pipeline.perception.objects import MAX_OBJECTS, Objects
from pipeline.world.layout import SIDE

FEATURES = ("area", "elongation", "length", "width", "contrast", "plain contrast")  # all of them as logarithms

# Step 1, background
WIDE_DRIFT = 4, 9  # (block [px], window [blocks]): medians over 36 x 36 pixels, wider than objects
CLOSE_DRIFT = 2, 3  # medians over 6 x 6 pixels remove mottles and keep lines of one or two pixels
NARROW_KERNEL, WIDE_KERNEL = (np.array(k, np.float32) / sum(k) for k in ((1, 2, 1), (1, 4, 6, 4, 1)))  # binomial

# Step 2, whitening
SHADOW_WEIGHT = 0.4  # weight of darkening without a change of hue, since objects cast shadows
MAX_TABLE_DEVIATION = 3.2  # pixels above it do not count as table when its variation is measured [deviations]
MIN_TABLE_SPREAD = 0.002  # smallest standard deviation of the table's colour [1 = white]

# Step 3, segmentation
MIN_REGION_DEVIATION = 4.5  # smallest deviation of every pixel of a region [deviations]
MIN_LINE_DEVIATION = 3.0  # smallest deviation of every pixel of a thin outline [deviations]
MIN_PEAK_DEVIATION = 6.0  # smallest peak deviation of a region or outline [deviations]
MIN_COMPONENT_PX = 12  # smaller regions belong to the table
MARGIN_PX = 2  # width of the border around a region that is included in it

# Step 4, outlines
SUPERSAMPLING = 4  # outline grid points per pixel along each axis
OUTLINE_SHARE = 0.5  # an object ends where its deviation falls to this share of its rim's ...
RIM_PX, RIM_QUANTILE = 3, 0.7  # ... which is this quantile over its outermost pixels ...
NEARBY_PX = 7  # ... or over a square of this side, if that is less: a handle is fainter than a blade
MIN_OUTLINE_DEVIATION = 2.7  # smallest deviation on an object's outline [deviations]
NECK_PX = 5.0  # parts joined by a narrower neck are separate objects

# Step 5, capsules and the table's own pattern
LONG_WIDENING_PX = 0.5  # added to a long object's radius: its outline lies this much too far inside
MIN_LONG_DEVIATION = 2.6  # smallest mean deviation of a long object: grain is fainter [deviations]
MAX_SPECK_M2, MAX_SPECK_ELONGATION = 0.003, 4.0  # a speck is faint, smaller and rounder than this ...
MIN_CAPSULE_OVERLAP = 0.65  # ... or faint and overlaps less with its capsule (intersection over union)
MIN_PATTERN_SPECKS = 3  # this many specks form the table's pattern: chips, knots, pieces of veins
# Mean squared distance of an object's pixels from their neighbours' mean, over the pixels' variance. Shuffled pixels
# reach 1.25. The threshold was chosen against the placebo of the refutation study, so that study cannot judge it.
MAX_TEXTURE_DISORDER = 0.75
NEIGHBOURS = np.array([[0, 1, 0], [1, 0, 1], [0, 1, 0]]) / 4  # mean over a pixel's four neighbours

SQUARE = np.ones((3, 3), np.uint8)  # structuring elements of 3 x 3 pixels
CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))

Colours = Float[Array, "row column 3"]
Deviations = Float[Array, "row column"]
Mask = UInt8[Array, "row column"]  # values 0 or 1
FineMask = UInt8[Array, "fine_row fine_column"]  # the finer grid of outlines

cv2.setNumThreads(1)  # stages run one process per core


def detect_objects(images: Float[Tensor, "scene 3 100 100"]) -> Objects:
    """Return the objects detected in each image [1 = white]; images do not affect each other."""
    objects = Objects(
        np.zeros((len(images), MAX_OBJECTS, 2, 2), np.float32),
        np.zeros((len(images), MAX_OBJECTS), np.float32),
        np.zeros((len(images), MAX_OBJECTS, len(FEATURES)), np.float32),
        np.zeros((len(images), MAX_OBJECTS), bool),
        np.zeros(len(images), np.float32),
    )
    pixels = images.detach().permute(0, 2, 3, 1).mul(255).round().to(torch.uint8).contiguous().numpy()
    for scene, image in enumerate(pixels):
        for i, object_ in enumerate(_detect(image.tobytes())):
            objects.ends[scene, i], objects.radius[scene, i] = object_.ends, object_.radius
            objects.features[scene, i], objects.present[scene, i] = object_.features, True
    return objects


class _Object(NamedTuple):
    ends: Float[Array, "2 2"]  # end points of the capsule's segment [m]
    radius: float  # of the capsule [m]
    features: Float[Array, " feature"]
    overlap: float  # intersection over union with its capsule
    disorder: float  # disorder of its texture, see MAX_TEXTURE_DISORDER


@lru_cache(maxsize=4096)  # 30 kB each; all models use the same images
def _detect(image: bytes) -> list[_Object]:
    """Return the MAX_OBJECTS largest objects in an 8-bit RGB image, the largest first."""
    contrast = measure_contrast(np.frombuffer(image, np.uint8).reshape(SIDE, SIDE, 3) / np.float32(255))
    large = segment(contrast.wide, MIN_REGION_DEVIATION)
    covered = cv2.dilate(np.maximum.reduce([np.zeros((SIDE, SIDE), np.uint8), *large]), SQUARE, iterations=MARGIN_PX)
    thin = segment(np.where(covered, 0, contrast.line), MIN_LINE_DEVIATION)
    outlines = [outline for region in large for outline in refine_outlines(region, contrast.narrow)]
    outlines += [outline for region in thin for outline in refine_outlines(region, contrast.line, thin=True)]
    objects = [object_ for outline in outlines if (object_ := describe(*outline, contrast)) is not None]
    ordered = [object_ for object_ in drop_specks(objects) if not object_.disorder >= MAX_TEXTURE_DISORDER]
    return sorted(ordered, key=lambda object_: -object_.features[0])[:MAX_OBJECTS]


# Steps 1 and 2: background and whitening
class Contrast(NamedTuple):
    """Each pixel's difference from the table; `wide`, `narrow` and `line` in deviations."""

    wide: Deviations  # smoothed widely, to detect objects
    narrow: Deviations  # smoothed less, to outline them
    line: Deviations  # response to lines one or two pixels wide
    plain: Deviations  # smoothed as `narrow`, but in [1 = white]
    whitened: Colours  # difference in each colour channel, not smoothed
    disorder: Deviations  # each pixel's squared distance from its neighbours' mean, minus the table's median


def measure_contrast(image: Float32[Array, "row column 3"]) -> Contrast:
    """Return an image [1 = white] after background subtraction and whitening."""
    background_free = subtract_background(torch.from_numpy(image.transpose(2, 0, 1).copy())[None])[0][0]
    difference = np.ascontiguousarray(background_free.numpy().transpose(1, 2, 0))
    difference = difference - _drift(difference, *WIDE_DRIFT)
    wide, narrow = (
        cv2.sepFilter2D(difference, -1, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
        for kernel in (WIDE_KERNEL, NARROW_KERNEL)
    )
    line = narrow - _drift(narrow, *CLOSE_DRIFT)
    table = np.median(image.reshape(-1, 3), axis=0)
    table = table / np.linalg.norm(table)
    darkening = np.minimum(narrow @ table, 0)
    without_shadow = narrow - (1 - SHADOW_WEIGHT) * darkening[..., None] * table
    whitening = whitening_matrix(narrow)
    whitened = difference @ whitening
    disorder = _length(whitened - cv2.filter2D(whitened, -1, NEIGHBOURS, borderType=cv2.BORDER_REPLICATE)) ** 2
    return Contrast(
        wide=_length(wide @ whitening_matrix(wide)),
        narrow=_length(without_shadow @ whitening),
        line=_length(line @ whitening_matrix(line)),
        plain=_length(narrow),
        whitened=whitened,
        disorder=disorder - np.median(disorder),  # noise does not count
    )


def _length(colours: Float[Array, "*pixel 3"]) -> Float[Array, "*pixel"]:
    return np.sqrt(np.einsum("...c,...c", colours, colours))


def _drift(difference: Colours, block: int, window: int) -> Colours:
    """Return the table's variation from place to place (boards, blotches, folds), extrapolated beyond the edges.

    It is the median over `window` by `window` blocks of the medians of `block` by `block` pixels.
    """
    blocks = difference.reshape(SIDE // block, block, SIDE // block, block, 3).swapaxes(1, 2)
    coarse = np.median(blocks.reshape(SIDE // block, SIDE // block, -1, 3), axis=2)
    beyond = window // 2
    coarse = np.pad(coarse, ((beyond, beyond), (beyond, beyond), (0, 0)), mode="reflect", reflect_type="odd")
    windows = np.lib.stride_tricks.sliding_window_view(coarse, (window, window), axis=(0, 1))
    medians = np.median(windows.reshape(*windows.shape[:3], -1), axis=-1)
    return cv2.resize(medians, (SIDE, SIDE), interpolation=cv2.INTER_LINEAR)


def whitening_matrix(difference: Colours) -> Float[Array, "3 3"]:
    """Return the symmetric matrix that scales the table's variation to 1 in every colour direction.

    Four rounds exclude the pixels that do not belong to the table.
    """
    colours = difference.reshape(-1, 3)
    is_table, whitening = np.ones(len(colours), bool), np.eye(3)
    for _ in range(4):
        table = colours[is_table]
        values, vectors = np.linalg.eigh(table.T @ table / len(table) + MIN_TABLE_SPREAD**2 * np.eye(3))
        whitening = vectors / np.sqrt(values) @ vectors.T
        is_table = _length(colours @ whitening) < MAX_TABLE_DEVIATION
    return whitening


# Step 3: segmentation
def segment(deviations: Deviations, least: float) -> list[Mask]:
    """Return connected regions above `least` with a peak above MIN_PEAK_DEVIATION, holes filled."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats((deviations > least).astype(np.uint8), connectivity=8)
    large = [label for label in range(1, count) if stats[label, cv2.CC_STAT_AREA] >= MIN_COMPONENT_PX]
    return [_fill(labels == label) for label in large if deviations[labels == label].max() >= MIN_PEAK_DEVIATION]


def _fill(mask: Array) -> Array:
    """Return a mask with its holes filled."""
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return cv2.drawContours(np.zeros(mask.shape, np.uint8), contours, -1, 1, cv2.FILLED)


# Step 4: outlines
def refine_outlines(region: Mask, deviations: Deviations, thin: bool = False) -> list[tuple[FineMask, tuple[int, int]]]:
    """Return the outline of each object in a region, as a mask on the finer grid and its corner (row, column).

    A `thin` outline that encloses nothing is broken; the object is then its convex hull.
    """
    left, top, width, height = cv2.boundingRect(region)
    corner = max(top - RIM_PX, 0), max(left - RIM_PX, 0)
    window = slice(corner[0], top + height + RIM_PX), slice(corner[1], left + width + RIM_PX)
    region, deviations = region[window], deviations[window].astype(np.float32)
    inner = cv2.erode(region, CROSS, iterations=RIM_PX, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    rim_level = np.quantile(deviations[(region > 0) & (inner == 0)], RIM_QUANTILE)
    nearby = cv2.dilate(np.where(region, deviations, 0), np.ones((NEARBY_PX, NEARBY_PX), np.uint8))
    around = cv2.dilate(region, SQUARE, iterations=MARGIN_PX)
    threshold = np.maximum(OUTLINE_SHARE * _finer(np.minimum(rim_level, nearby)), MIN_OUTLINE_DEVIATION)
    inside = _finer(np.where(around, deviations, 0)) > threshold
    count, pieces = cv2.connectedComponents(_fill(inside), connectivity=4)
    parts = []
    for piece in ((pieces == label).astype(np.uint8) for label in range(1, count)):
        is_broken = thin and (piece & ~inside).sum() < MIN_COMPONENT_PX * SUPERSAMPLING**2
        parts += [_convex_hull(piece)] if is_broken else _cut_at_necks(piece)
    return [(part, corner) for part in parts if part.sum() >= MIN_COMPONENT_PX * SUPERSAMPLING**2]


def _finer(values: Float[Array, "row column"]) -> Float[Array, "fine_row fine_column"]:
    scale = SUPERSAMPLING
    return cv2.resize(values.astype(np.float32), None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)


def _cut_at_necks(mask: FineMask) -> list[FineMask]:
    """Return a mask's parts, cut at necks: each pixel belongs to the nearest part that is wider than a neck."""
    depth = distance_transform_edt(np.pad(mask, 1))[1:-1, 1:-1]
    count, wide = cv2.connectedComponents((depth > NECK_PX / 2 * SUPERSAMPLING).astype(np.uint8), connectivity=4)
    if count < 3:
        return [mask]
    nearest = np.argmin([distance_transform_edt(wide != part) for part in range(1, count)], axis=0)
    return [mask & (nearest == part) for part in range(count - 1)]


def _convex_hull(mask: FineMask) -> FineMask:
    """Return the convex hull of a mask's pixels, as a mask."""
    return cv2.fillConvexPoly(np.zeros_like(mask), cv2.convexHull(cv2.findNonZero(mask)), 1)


# Step 5: capsules and the table's own pattern
def describe(mask: FineMask, corner: tuple[int, int], contrast: Contrast) -> _Object | None:
    """Return an outlined object's capsule and features; None for a long object as faint as grain."""
    rows, columns = np.nonzero(mask)
    y, x = corner[0] + (rows + 0.5) / SUPERSAMPLING, corner[1] + (columns + 0.5) / SUPERSAMPLING  # [pixels]
    points = np.stack([x, SIDE - y], -1) / SIDE  # [m]
    capsule = fit_capsule(points, SUPERSAMPLING * SIDE)
    pixels = y.astype(int), x.astype(int)
    deviation = contrast.narrow[pixels].mean()
    radius = capsule.radius
    if capsule.elongation > MIN_LONG_ELONGATION:
        radius += LONG_WIDENING_PX / SIDE
        if deviation < MIN_LONG_DEVIATION:
            return None
    length = 2 * (np.linalg.norm(capsule.half) + radius)
    features = [capsule.area, capsule.elongation, length, 2 * radius, deviation, contrast.plain[pixels].mean()]
    covered = np.zeros((SIDE, SIDE), np.uint8)
    covered[pixels] = 1
    covered = cv2.dilate(covered, SQUARE) > 0
    return _Object(
        np.stack([capsule.centre - capsule.half, capsule.centre + capsule.half]),
        radius,
        np.log(np.array(features)),
        overlap(points, capsule._replace(radius=radius), SUPERSAMPLING * SIDE),
        contrast.disorder[covered].mean() / contrast.whitened[covered].var(0).sum(),
    )


def overlap(points: Float[Array, "point 2"], capsule: Capsule, per_metre: int) -> float:
    """Return the intersection over union of a capsule and points [m] on a grid of `per_metre` points per metre."""
    offsets, half, radius = points - capsule.centre, capsule.half, capsule.radius
    share = np.clip(offsets @ half / max(half @ half, 1e-12), -1, 1)
    inside = np.linalg.norm(offsets - share[:, None] * half, axis=1) <= radius
    intersection = inside.sum() / per_metre**2
    union = len(points) / per_metre**2 + np.pi * radius**2 + 4 * radius * np.linalg.norm(half) - intersection
    return float(intersection / union)


def drop_specks(objects: list[_Object]) -> list[_Object]:
    """Drop faint specks if there are MIN_PATTERN_SPECKS or more, as the table's pattern; fewer may be objects."""
    features = np.exp(np.reshape([object_.features for object_ in objects], (-1, len(FEATURES))))
    area, elongation, deviation = (features[:, FEATURES.index(name)] for name in ("area", "elongation", "contrast"))
    no_capsule = np.array([object_.overlap for object_ in objects]) < MIN_CAPSULE_OVERLAP
    small = (area < MAX_SPECK_M2) & (elongation < MAX_SPECK_ELONGATION)
    specks = (small | no_capsule) & (deviation < MIN_PEAK_DEVIATION)
    if specks.sum() < MIN_PATTERN_SPECKS:
        return objects
    return [object_ for object_, is_speck in zip(objects, specks, strict=True) if not is_speck]
