"""A pool of composites on disk, in parts that the training maps into memory as they appear."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from making.segmenter.composites import Composites
from making.segmenter.drawn import DrawnScenes

PART = 500  # pictures in a part: 40 MB
NEAR_PX = 2  # two items this near to a pixel are too close to tell apart there
_NEAR = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * NEAR_PX + 1, 2 * NEAR_PX + 1))

Part = UInt8[Array, "picture 100 100 10"]  # channels: as named below
COLOURS, EMPTY = slice(3), slice(3, 6)  # of the picture, and of the empty table's
ITEM, BETWEEN, SEE_THROUGH = 6, 7, 8  # the truth, see `segmenter.Maps`
KNOWN = 9  # whether item and between are known there

Pictures = DrawnScenes | Composites


def pack(pictures: Pictures) -> Part:
    """Return pictures as one array, with the truth that the segmenter learns: see `segmenter.MAPS`."""
    truth = [pictures.instances > 0, [between(i) for i in pictures.instances], pictures.see_through > 0]
    truth.append(np.ones_like(truth[0]))
    return np.concatenate([pictures.images, pictures.empty, np.stack(truth, -1).astype(np.uint8)], -1)


def between(instances: UInt8[Array, "row column"]) -> UInt8[Array, "row column"]:
    """Return 1 where two items are within NEAR_PX, which is where one must be cut from the other."""
    present = [(instances == i).astype(np.uint8) for i in range(1, instances.max() + 1)]
    count = sum((cv2.dilate(mask, _NEAR) for mask in present), np.zeros_like(instances))
    return (count > 1).astype(np.uint8)


def part_file(folder: Path, part: int) -> Path:
    """Return the file of a part."""
    return folder / f"part-{part:04d}.npy"


def write_part(folder: Path, part: int, draw: Callable[[np.random.Generator, int], list[Part]], seed: int) -> None:
    """Draw a part from its own random stream and write it; a part that is there already is kept."""
    path = part_file(folder, part)
    if not path.exists():
        pictures = np.concatenate(draw(np.random.default_rng([seed, part]), PART))
        partial = path.with_suffix(".partial.npy")
        np.save(partial, pictures)
        partial.rename(path)
