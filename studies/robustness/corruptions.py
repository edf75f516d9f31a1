"""Corruptions of images, scenes and labels.

With the same generator, a stronger corruption extends a weaker one: the shadow falls on the same side, the arm reaches
further at the same place, and added items and label errors include the weaker ones.
"""

from collections.abc import Callable
from dataclasses import fields

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.world.layout import SIDE, SYMBOLS, Items, LayoutRules, Layouts, add_item, empty

Images = UInt8[Array, "scene 100 100 3"]
ARM_RADIUS_PX = 4  # an arm is 8 cm wide; a pixel is 1 cm
PIXEL_CENTRES = (np.arange(SIDE) + 0.5) / SIDE  # centres of rows and columns [m]
WARM_LIGHT = np.array([0.0, 0.5, 1.0])  # share of the loss in red, green and blue


def shade(rng: np.random.Generator, images: Images, loss: float) -> Images:
    """Return the images darkened linearly across the table, by the share `loss` at the far end.

    Each image has a random direction.
    """
    bearing = rng.uniform(-np.pi, np.pi, (len(images), 1, 1))
    c, s = np.cos(bearing), np.sin(bearing)
    along = c * (PIXEL_CENTRES - 0.5) + s * (PIXEL_CENTRES[:, None] - 0.5)
    distance = 0.5 + along / (abs(c) + abs(s))  # (scene, row, column), 0 to 1
    return _to_uint8(images / 255 * (1 - loss * distance[..., None]))


def tint(rng: np.random.Generator, images: Images, loss: float) -> Images:
    """Return the images under warmer light: without the share `loss` of the blue and half as much of the green."""
    return _to_uint8(images / 255 * (1 - loss * WARM_LIGHT))


def blur(rng: np.random.Generator, images: Images, sigma_px: float) -> Images:
    """Return the images blurred by a Gaussian of this standard deviation [px]."""
    unit = (images / 255).astype(np.float32)
    return _to_uint8(np.stack([cv2.GaussianBlur(x, (0, 0), sigma_px, borderType=cv2.BORDER_REPLICATE) for x in unit]))


def noise(rng: np.random.Generator, images: Images, sigma: float) -> Images:
    """Return the images with normal noise of this standard deviation [1 = white] on every pixel and channel."""
    return _to_uint8(images / 255 + sigma * rng.standard_normal(images.shape))


def arm(rng: np.random.Generator, images: Images, reach_m: float) -> Images:
    """Return the images with a grey arm with a round end, reaching straight in from a random edge by `reach_m` [m]."""
    corrupted = images.copy()
    for image in corrupted:
        edge, column, grey = int(rng.integers(4)), round(SIDE * rng.uniform(0.15, 0.85)), rng.uniform(0.2, 0.8)
        tip = round(SIDE * reach_m) - 1 - ARM_RADIUS_PX  # row of the round end's centre
        mask = np.zeros((SIDE, SIDE), np.uint8)
        cv2.line(mask, (column, -2 * ARM_RADIUS_PX), (column, tip), 1, thickness=2 * ARM_RADIUS_PX)
        image[np.rot90(mask, edge) > 0] = round(255 * grey)
    return corrupted


CORRUPTIONS: dict[str, Callable[[np.random.Generator, Images, float], Images]] = {
    f.__name__: f for f in (shade, tint, blur, noise, arm)
}


def _to_uint8(images: Float[Array, "*shape"]) -> UInt8[Array, "*shape"]:
    return np.rint(np.clip(images, 0, 1) * 255).astype(np.uint8)


def add_clutter(
    rng: np.random.Generator, layouts: Layouts, count: int, items: Items, pool: Int[Array, " pool"], rules: LayoutRules
) -> Layouts:
    """Return the scenes with `count` additional items of `pool` (catalogue rows), of random symbols.

    Items keep the minimum distances of `rules`. Raises InputError if a scene has no room for them.
    """
    free = empty(len(layouts), count)
    padded = Layouts(*(np.concatenate([getattr(x, f.name) for x in (layouts, free)], axis=1) for f in fields(Layouts)))
    scenes = []
    for i, scene_rng in enumerate(rng.spawn(len(layouts))):
        scene = padded[[i]]
        for _ in range(count):
            scene = add_item(scene_rng, scene, int(scene_rng.integers(len(SYMBOLS))), items, pool, rules)
        scenes.append(scene)
    return Layouts(*(np.concatenate([getattr(scene, f.name) for scene in scenes]) for f in fields(Layouts)))


def flip_labels(rng: np.random.Generator, valid: Bool[Array, "scene n"], share: float) -> Bool[Array, "scene n"]:
    """Return the labels with this share flipped at random, rounded to a whole number of labels."""
    flipped = np.zeros(valid.size, dtype=bool)
    flipped[rng.permutation(valid.size)[: round(share * valid.size)]] = True
    return valid ^ flipped.reshape(valid.shape)
