"""Read pictures that people took, safely: what is damaged or huge is refused by a sentence."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.world.catalogue import MIN_VISIBLE_ALPHA
from pipeline.world.images import decode, image_size

DARKEST_WHITE = 16384  # of 16 bits: cameras of 10, 12 or 14 bits leave the highest unused
MAX_PIXELS = 50_000_000  # 150 MB decoded; phones take 12 to 48 million


def read_picture(path: Path, name: str) -> UInt8[Array, "row column 3"]:
    """Return a photograph as RGB, turned upright as its EXIF data says.

    Raise InputError, which calls it `name`, if it is neither PNG nor JPEG, above MAX_PIXELS, or damaged.
    """
    pixels = _eight_bits(decoded(path, name, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH), name)
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB)


def read_cutout(path: Path, name: str) -> UInt8[Array, "row column 4"]:
    """Return a cut-out as RGBA, straight alpha; InputError as `read_picture`, or if all is invisible or opaque."""
    pixels = _eight_bits(decoded(path, name, cv2.IMREAD_UNCHANGED), name)
    if pixels.ndim != 3 or pixels.shape[2] != 4:
        raise InputError(f"{name} has no transparent background: expected an RGBA png; cut the object out")
    if (highest := pixels[..., 3].max()) <= MIN_VISIBLE_ALPHA:
        raise InputError(f"{name} has an alpha of at most {highest} of 255: expected 255 where the object is")
    if pixels[..., 3].min() == 255:
        raise InputError(f"{name} is opaque everywhere: expected an object on a transparent background")
    return cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA)


def decoded(path: Path, name: str, flag: int) -> Array:
    """Return the pixels as OpenCV gives them, counted before they are decoded; InputError as `read_picture`."""
    try:
        width, height = image_size(path)
    except InputError as error:
        raise InputError(f"{name} cannot be read: expected a whole PNG or JPEG picture; save it again") from error
    if width * height > MAX_PIXELS:
        most = f"{MAX_PIXELS // 1_000_000} megapixels"
        raise InputError(f"{name} has {width} x {height} pixels: expected at most {most}; scale it down")
    pixels, damage = decode(path, flag)
    if pixels is None or damage:
        why = f" ({damage})" if damage else ""
        raise InputError(f"{name} is truncated or damaged{why}: expected a whole PNG or JPEG picture; copy it again")
    return pixels


def _eight_bits(pixels: Array, name: str) -> Array:
    """Return pixels of 8 or 16 bits a channel with 8; raise InputError if white cannot be 65,535 of 16 bits."""
    if pixels.dtype == np.uint8:
        return pixels
    colours = pixels[..., :3] if pixels.ndim == 3 else pixels  # alpha has a white of its own
    if (highest := int(colours.max())) < DARKEST_WHITE:
        came = f"{name} has 16 bits a channel, and its brightest value is {highest:,}"
        raise InputError(f"{came}: expected 65,535 for white; scale all pictures alike, or save them with 8 bits")
    return np.rint(pixels * (255 / 65535)).astype(np.uint8)
