"""New looks for training scenes that leave labels alone: things repainted and set on other tables, whatever they are.

A thing is a blob, a connected region that stands out from the table; nothing here sees a layout or a label.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int
from numpy import ndarray as Array
from scipy import ndimage

CUT = 2.1  # contrast, in the table's standard deviations, from which a pixel is no table
MOST = 0.1  # share of the pixels that may belong to blobs
SMALLEST = 12  # pixels; smaller regions belong to the table
SOFTENING = 0.5  # pixels; repainting draws no new edges


@dataclass(frozen=True)
class Jitter:
    """How far looks may stray (conf/irl)."""

    hue: float  # largest turn of a blob's colour about the grey axis [rad]
    gain: float  # standard deviation of the logarithm of a blob's contrast
    shift: float  # standard deviation of a colour added to a blob, per channel [1 = white]
    scene_gain: float  # standard deviation of the logarithm of a whole scene's contrast
    other_table: float  # chance that a scene's blobs are set on another training scene's table


def blobs(contrast: Float32[Array, "scene row column"]) -> Int[Array, "scene row column"]:
    """Label of the blob each pixel belongs to, 0 for the table; `contrast` in the table's standard deviations."""
    labels = np.zeros(contrast.shape, np.int64)
    for scene, picture in enumerate(contrast):
        regions, count = ndimage.label(picture > max(CUT, np.quantile(picture, 1 - MOST)))
        sizes = ndimage.sum_labels(np.ones_like(picture), regions, np.arange(count + 1))
        kept = np.flatnonzero((sizes >= SMALLEST) & (np.arange(count + 1) > 0))
        renumber = np.zeros(count + 1, np.int64)
        renumber[kept] = np.arange(1, len(kept) + 1)
        labels[scene] = renumber[regions]
    return labels


def new_looks(
    rng: np.random.Generator,
    plain: Float32[Array, "scene 3 row column"],
    labels: Int[Array, "scene row column"],
    jitter: Jitter,
) -> tuple[Float32[Array, "scene 3 row column"], Int[Array, " scene"]]:
    """The scenes' differences from the table in new looks, and the scene whose table each one stands on now."""
    own = np.arange(len(plain))
    table = np.where(rng.random(len(plain)) < jitter.other_table, rng.permutation(len(plain)), own)
    painted = repaint(rng, plain, labels, jitter)
    thing = ndimage.binary_dilation(labels > 0, np.ones((1, 3, 3))).astype(np.float32)
    thing = ndimage.gaussian_filter(thing, (0, SOFTENING, SOFTENING))[:, None]  # (scene, 1, row, column)
    tops = _turned(rng, plain * (1 - thing))[table]
    moved = thing * painted + (1 - thing) * tops
    return np.where((table == own)[:, None, None, None], painted, moved).astype(np.float32), table


def repaint(
    rng: np.random.Generator,
    plain: Float32[Array, "scene 3 row column"],
    labels: Int[Array, "scene row column"],
    jitter: Jitter,
) -> Float32[Array, "scene 3 row column"]:
    """The scenes' differences from the table, every blob turned in hue, scaled and shifted at random."""
    scenes, most = len(plain), int(labels.max()) + 1
    hue = rng.uniform(-jitter.hue, jitter.hue, (scenes, most))
    gain = np.exp(rng.normal(0, jitter.gain, (scenes, most)))
    change = _hue_rotation(hue) * gain[..., None, None] - np.eye(3)  # (scene, blob, 3, 3)
    shift = rng.normal(0, jitter.shift, (scenes, most, 3))
    repainted = np.empty_like(plain)
    for scene in range(scenes):
        added = np.zeros_like(plain[scene])
        for blob in range(1, most):
            at = labels[scene] == blob
            added[:, at] = change[scene, blob] @ plain[scene][:, at] + shift[scene, blob][:, None]
        repainted[scene] = plain[scene] + ndimage.gaussian_filter(added, (0, SOFTENING, SOFTENING))
    overall = np.exp(rng.normal(0, jitter.scene_gain, (scenes, 1, 1, 1)))
    return (overall * repainted).astype(np.float32)


def _turned(rng: np.random.Generator, tops: Array) -> Array:
    """Table tops under one random symmetry of the square."""
    tops = np.rot90(tops, int(rng.integers(4)), (2, 3))
    return np.swapaxes(tops, 2, 3) if rng.integers(2) else tops


def _hue_rotation(angle: Array) -> Array:
    """Rotation (..., 3, 3) of RGB by `angle` [rad] about the grey axis (Rodrigues' formula)."""
    c, s = np.cos(angle)[..., None, None], np.sin(angle)[..., None, None]
    cross = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3)
    return c * np.eye(3) + (1 - c) / 3 + s * cross
