"""Augment training scenes: recolour their blobs, and paste them on other scenes' table tops; labels stay the same.

A blob is a connected region that differs from the table. Neither layouts nor labels are used.
"""

import numpy as np
from jaxtyping import Float32, Int
from numpy import ndarray as Array
from scipy import ndimage

from pipeline.runtime.settings import Chance, Group, Spread, Weight

MIN_CONTRAST = 2.1  # smallest contrast of a blob's pixels [standard deviations of the table]
MAX_BLOB_SHARE = 0.1  # largest share of an image's pixels in blobs
MIN_BLOB_PX = 12  # smaller regions belong to the table
SOFTENING_PX = 0.5  # standard deviation of the blur that prevents recolouring from creating edges


class ColorJitter(Group):
    """Range of the random changes in appearance (conf/irl.yaml)."""

    hue: Weight  # largest rotation of a blob's colour about the grey axis [rad]
    gain: Spread  # standard deviation of the logarithm of a blob's contrast
    shift: Spread  # standard deviation per channel of the colour added to a blob [1 = white]
    scene_gain: Spread  # standard deviation of the logarithm of a whole scene's contrast
    other_table: Chance  # probability that a scene's blobs are pasted on another training scene's table top


def blobs(contrast: Float32[Array, "scene row column"]) -> Int[Array, "scene row column"]:
    """Return each pixel's blob number, 0 for the table, from `contrast` [standard deviations of the table]."""
    labels = np.zeros(contrast.shape, np.int64)
    for scene, image in enumerate(contrast):
        regions, _ = ndimage.label(image > max(MIN_CONTRAST, np.quantile(image, 1 - MAX_BLOB_SHARE)))
        large = np.bincount(regions.ravel()) >= MIN_BLOB_PX
        large[0] = False
        labels[scene] = np.where(large, large.cumsum(), 0)[regions]
    return labels


def augment_appearances(
    rng: np.random.Generator, plain: Float32[Array, "scene 3 row column"], labels: Array, jitter: ColorJitter
) -> tuple[Float32[Array, "scene 3 row column"], Int[Array, " scene"]]:
    """Return the augmented differences from the table, and the index of the scene that each table top comes from.

    labels: `blobs` of the scenes. Each blob's colour is rotated in hue, scaled and shifted at random; a table top is
    turned or reflected at random.
    """
    scenes, count = np.arange(len(plain)), int(labels.max()) + 1
    table = np.where(rng.random(len(plain)) < jitter.other_table, rng.permutation(len(plain)), scenes)

    hue = rng.uniform(-jitter.hue, jitter.hue, (len(plain), count))
    gain = np.exp(rng.normal(0, jitter.gain, (len(plain), count)))
    c, s = np.cos(hue)[..., None, None], np.sin(hue)[..., None, None]
    cross = np.array([[0, -1, 1], [1, 0, -1], [-1, 1, 0]]) / np.sqrt(3)
    rotation = c * np.eye(3) + (1 - c) / 3 + s * cross  # about the grey axis (Rodrigues' formula)
    change = rotation * gain[..., None, None] - np.eye(3)  # (scene, blob, 3, 3)
    shift = rng.normal(0, jitter.shift, (len(plain), count, 3))
    recoloured = np.empty_like(plain)
    for scene in scenes:
        added = np.zeros_like(plain[scene])
        for blob in range(1, count):
            mask = labels[scene] == blob
            added[:, mask] = change[scene, blob] @ plain[scene][:, mask] + shift[scene, blob][:, None]
        recoloured[scene] = plain[scene] + ndimage.gaussian_filter(added, (0, SOFTENING_PX, SOFTENING_PX))
    scene_gain = np.exp(rng.normal(0, jitter.scene_gain, (len(plain), 1, 1, 1)))
    recoloured = (scene_gain * recoloured).astype(np.float32)

    inside = ndimage.binary_dilation(labels > 0, np.ones((1, 3, 3))).astype(np.float32)
    inside = ndimage.gaussian_filter(inside, (0, SOFTENING_PX, SOFTENING_PX))[:, None]  # (scene, 1, row, column)
    table_tops = np.rot90(plain * (1 - inside), int(rng.integers(4)), (2, 3))
    table_tops = (np.swapaxes(table_tops, 2, 3) if rng.integers(2) else table_tops)[table]
    moved = inside * recoloured + (1 - inside) * table_tops
    return np.where((table == scenes)[:, None, None, None], recoloured, moved).astype(np.float32), table
