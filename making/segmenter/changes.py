"""Change training pictures each time they are used: turns, colours, noise, fainter items, and patterns on items."""

import math

import cv2
import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray as Array
from torch import Tensor

from making.segmenter.pool import COLOURS, EMPTY, ITEM, KNOWN, SEE_THROUGH, Part
from pipeline.perception.segmenter import network_input
from pipeline.world.layout import SIDE

GAIN = 0.8, 1.2  # of each colour channel
MAX_LOG_GAMMA = 0.4
P_SHUFFLE = 0.5  # probability that colour channels change places
MAX_NOISE = 0.012  # standard deviation of the noise that is added [1 = white]
NOISE = np.random.default_rng(1).standard_normal(4_000_000, np.float32)  # drawn once: noise takes long to draw
P_EMPTY = 0.5  # probability that the empty table's picture is given
P_FADE, MIN_FADE = 0.3, 0.3  # probability that items and shadows become fainter, and the least share that stays
P_PATTERN = 0.18  # probability that an opaque item is painted with a fine pattern
MIN_PATTERN_PX = 60  # smallest item that is painted [pixels]

Inputs = Float[Tensor, "picture 7 100 100"]
Truth = Float[Tensor, "picture 4 100 100"]  # item, between, see-through, known


def change(rng: np.random.Generator, pictures: Part) -> tuple[Inputs, Truth]:
    """Return pictures as the segmenter's input and the truth, each of them changed at random."""
    n, levels = len(pictures), np.arange(256, dtype=np.float32) / 255
    colours, truth = np.empty((n, SIDE, SIDE, 6), np.float32), np.empty((n, SIDE, SIDE, 4), np.uint8)
    for i, picture in enumerate(pictures.copy()):
        paint(rng, picture)
        if rng.random() < P_FADE:
            fade(picture, rng.uniform(MIN_FADE, 1))
        turned = np.rot90(picture, int(rng.integers(4)))
        turned = turned[:, ::-1] if rng.random() < 0.5 else turned
        truth[i] = turned[..., ITEM:]
        gamma = math.exp(rng.uniform(-MAX_LOG_GAMMA, MAX_LOG_GAMMA))
        order = rng.permutation(3) if rng.random() < P_SHUFFLE else range(3)
        for channel, source in enumerate(order):
            curve = levels**gamma * np.float32(rng.uniform(*GAIN))
            for first in (0, 3):  # the picture, and the empty table's
                colours[i, ..., first + channel] = curve[turned[..., first + source]]
    first = rng.integers(len(NOISE) - colours.size)
    noise = NOISE[first : first + colours.size].reshape(colours.shape)
    colours += noise * rng.uniform(0, MAX_NOISE, (n, 1, 1, 1)).astype(np.float32)
    np.clip(colours, 0, 1, out=colours)
    inputs = network_input(colours[..., :3], colours[..., 3:])
    inputs[torch.from_numpy(rng.random(n) >= P_EMPTY), 3:] = 0
    return inputs, torch.from_numpy(truth).permute(0, 3, 1, 2).float()


def fade(picture: Array, share: float) -> None:
    """Leave only a share of what items and shadows change in the empty table's picture."""
    table = picture[..., EMPTY].astype(np.float32)
    picture[..., COLOURS] = np.rint(table + share * (picture[..., COLOURS] - table))


def paint(rng: np.random.Generator, picture: Array) -> None:
    """Paint stripes, checks, rays or rings on some opaque items: an item is known by its outline, not by its texture.

    See-through and small items stay as they are, and so do path-traced ones, whose outlines are not known.
    """
    if not picture[..., KNOWN].all():
        return
    count, labels, stats, centroids = cv2.connectedComponentsWithStats(picture[..., ITEM], connectivity=4)
    for k in range(1, count):
        left, top, width, height, area = stats[k]
        window = picture[top : top + height, left : left + width]
        item = labels[top : top + height, left : left + width] == k
        if area < MIN_PATTERN_PX or rng.random() > P_PATTERN or window[..., SEE_THROUGH][item].mean() > 0.5:
            continue
        y, x = np.mgrid[:height, :width] - (centroids[k][::-1] - (top, left))[:, None, None]
        share = _pattern(rng, x, y)
        if rng.random() < 0.4:  # a middle, or a rim, of one colour
            share[np.hypot(x, y) < rng.uniform(0.3, 0.8) * np.sqrt(area / np.pi)] = rng.integers(2)
        first = rng.uniform(0, 255, 3)
        second = rng.uniform(0, 255, 3) if rng.random() < 0.6 else first + rng.normal(0, 90, 3)
        colour = second + share[..., None] * (first - second)
        opacity = rng.uniform(0.3, 1) * item[..., None]
        window[..., COLOURS] = np.clip(np.rint(window[..., COLOURS] * (1 - opacity) + opacity * colour), 0, 255)


def _pattern(rng: np.random.Generator, x: Array, y: Array) -> Array:
    """Return the share of the first of two colours at each place [pixels from the item's middle]."""
    turn, frequency = rng.uniform(0, np.pi), 2 * np.pi / rng.uniform(2.2, 9)
    u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    wave = (
        lambda: np.sin(frequency * u),
        lambda: np.sin(frequency * u) * np.sin(frequency * v),
        lambda: np.sin(rng.integers(5, 24) * np.arctan2(y, x) + turn),
        lambda: np.sin(frequency * np.hypot(x, y) + turn),
    )[rng.integers(4)]()
    return np.clip(0.5 + rng.uniform(0.5, 3) * wave, 0, 1)
