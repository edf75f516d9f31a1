"""Augment training scenes of the paper's model as those of the reward map: other colours, table tops and symmetries."""

from functools import lru_cache
from zlib import crc32

import numpy as np
import torch
from jaxtyping import Float, UInt8
from numpy import ndarray as Array

from pipeline.models.base import to_tensor
from pipeline.models.irl.reward_map import contrast
from pipeline.perception.background import subtract_background
from pipeline.training.irl.augment import ColorJitter, augment_appearances, blobs
from pipeline.world.layout import SIDE

SYMMETRIES = 4  # those of the square that keep start and goal, or exchange them; a path's control point moves along


@lru_cache(maxsize=32)  # all models of a training set use the same augmentations
def appearances(images: bytes, count: int, jitter: ColorJitter) -> UInt8[Array, "appearance scene 100 100 3"]:
    """Return `count` versions of the training scenes, the original first; the images alone decide them."""
    scenes = np.frombuffer(images, np.uint8).reshape(-1, SIDE, SIDE, 3)
    rng, x = np.random.default_rng(crc32(images)), to_tensor(scenes.copy())
    plain, whitening = subtract_background(x)
    labels = blobs(contrast(plain, whitening)[:, 0].sinh().numpy())
    versions = [scenes]
    for _ in range(count - 1):
        recoloured, table = augment_appearances(rng, plain.numpy(), labels, jitter)
        version = (x - plain)[torch.from_numpy(table)] + torch.from_numpy(recoloured)
        versions.append((255 * version.clamp(0, 1)).round().to(torch.uint8).permute(0, 2, 3, 1).numpy())
    return np.stack(versions)


def turn_images(images: Array, symmetry: int) -> Array:
    """Return images (..., row, column, channel) turned by 180 degrees (bit 1) and transposed (bit 2)."""
    turned = images[..., ::-1, ::-1, :] if symmetry & 1 else images
    return turned.swapaxes(-2, -3) if symmetry & 2 else turned


def turn_paths(z_theta: Float[Array, "*path 2"], symmetry: int) -> Float[Array, "*path 2"]:
    """Return the control points [m] of the same paths in images turned by `turn_images`."""
    turned = 1 - z_theta if symmetry & 1 else z_theta
    return 1 - turned[..., ::-1] if symmetry & 2 else turned  # row 0 is the far edge, so a transpose is (1 - y, 1 - x)
