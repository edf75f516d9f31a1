"""What can be worse at use, or in the labels, than it was in training: pictures, tables and demonstrations.

Under the same generator a stronger disturbance of a kind only deepens a weaker one: the same side in the shade, the
same arm further in, the same items and others besides.
"""

from collections.abc import Callable
from dataclasses import fields

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array
from scipy.ndimage import gaussian_filter

from pipeline.world.layout import SIDE, SYMBOLS, Items, LayoutRules, Layouts, add_item, empty

Pictures = UInt8[Array, "scene 100 100 3"]
HALF_ARM = 0.04  # half of an arm's thickness [m]
_CENTRES = (np.arange(SIDE) + 0.5) / SIDE  # of rows and columns [m]


def shade(rng: np.random.Generator, images: Pictures, lost: float) -> Pictures:
    """Light from one side: it falls in a straight line across the table, by the share `lost` from end to end.

    Each picture has a direction of its own.
    """
    bearing = rng.uniform(-np.pi, np.pi, (len(images), 1, 1))
    c, s = np.cos(bearing), np.sin(bearing)
    along = c * (_CENTRES - 0.5) + s * (_CENTRES[:, None] - 0.5)
    share = 0.5 + along / (abs(c) + abs(s))  # (scene, row, column), 0 to 1
    return _eight_bit(images / 255 * (1 - lost * share[..., None]))


def tint(rng: np.random.Generator, images: Pictures, lost: float) -> Pictures:
    """Light of a warmer colour: the share `lost` of the blue is gone, and half as much of the green."""
    return _eight_bit(images / 255 * (1 - lost * np.array([0.0, 0.5, 1.0])))


def blur(rng: np.random.Generator, images: Pictures, deviation: float) -> Pictures:
    """A Gaussian of that standard deviation [px] over all of the picture, its grain and noise too."""
    return _eight_bit(gaussian_filter(images / 255, (0, deviation, deviation, 0), mode="nearest"))


def noise(rng: np.random.Generator, images: Pictures, deviation: float) -> Pictures:
    """Normal noise of that standard deviation [1 = white] in every pixel and colour."""
    return _eight_bit(images / 255 + deviation * rng.standard_normal(images.shape))


def arm(rng: np.random.Generator, images: Pictures, reach: float) -> Pictures:
    """An arm that comes in straight over a random edge and ends `reach` [m] from it, round and of one grey."""
    pictures = images.copy()
    for picture in pictures:
        edge, place, grey = int(rng.integers(4)), rng.uniform(0.15, 0.85), rng.uniform(0.2, 0.8)
        beyond = np.maximum(_CENTRES[:, None] - (reach - HALF_ARM), 0)  # of the middle of the round end [m]
        over = np.hypot(_CENTRES - place, beyond) < HALF_ARM  # as it comes in over row 0
        picture[np.rot90(over, edge)] = np.rint(255 * grey)
    return pictures


PICTURES: dict[str, Callable[[np.random.Generator, Pictures, float], Pictures]] = {
    "shade": shade,
    "tint": tint,
    "blur": blur,
    "noise": noise,
    "arm": arm,
}  # by name; strength 0 returns every picture as it is


def _eight_bit(picture: Float[Array, "*shape"]) -> UInt8[Array, "*shape"]:
    return np.rint(np.clip(picture, 0, 1) * 255).astype(np.uint8)


def cluttered(
    rng: np.random.Generator, layouts: Layouts, more: int, items: Items, pool: Int[Array, " pool"], rules: LayoutRules
) -> Layouts:
    """The same scenes with `more` further items of `pool` (catalogue indices), of random symbols.

    They keep the clearances of `rules`; ValueError if a scene has no room for them.
    """
    room = empty(len(layouts), more)
    roomy = Layouts(*(np.concatenate([getattr(x, f.name) for x in (layouts, room)], axis=1) for f in fields(Layouts)))
    scenes = []
    for i, own in enumerate(rng.spawn(len(layouts))):
        scene = roomy[[i]]
        for _ in range(more):
            scene = add_item(own, scene, int(own.integers(len(SYMBOLS))), items, pool, rules)
        scenes.append(scene)
    return Layouts(*(np.concatenate([getattr(scene, f.name) for scene in scenes]) for f in fields(Layouts)))


def mislabelled(rng: np.random.Generator, valid: Bool[Array, "scene n"], share: float) -> Bool[Array, "scene n"]:
    """The labels of a training set, `share` of them flipped at random: that many, to the nearest whole number."""
    flipped = np.zeros(valid.size, dtype=bool)
    flipped[rng.permutation(valid.size)[: round(share * valid.size)]] = True
    return valid ^ flipped.reshape(valid.shape)
