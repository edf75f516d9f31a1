"""Read photographs safely: the size is checked before decoding, and a truncated file is refused."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.world.images import JPEG_SIGNATURE, PNG_SIGNATURE, image_size

ENDINGS = (".jpg", ".jpeg", ".png")
MAX_PIXELS = 50_000_000  # 150 MB decoded; phones take 12 to 48 million
END_OF_JPEG, END_OF_PNG = b"\xff\xd9", b"IEND"
SCAN = 0xDA  # the JPEG segment after which the pixels follow


def read_picture(path: Path) -> UInt8[Array, "row column 3"]:
    """Return a photograph as RGB, turned upright as its EXIF data says.

    Raises InputError if it is missing, neither PNG nor JPEG, above MAX_PIXELS, or truncated.
    """
    return cv2.cvtColor(_decoded(path, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def read_cutout(path: Path) -> UInt8[Array, "row column 4"]:
    """Return a cut-out as RGBA with straight alpha.

    Raises InputError as `read_picture`, and if nothing or everything in it is transparent.
    """
    pixels = _decoded(path, cv2.IMREAD_UNCHANGED)
    if pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype != np.uint8:
        raise InputError("has no transparent background: expected an 8-bit RGBA png; cut the object out")
    alpha = pixels[..., 3]
    if alpha.max() == 0 or alpha.min() == 255:
        state = "transparent" if alpha.max() == 0 else "opaque"
        raise InputError(f"is {state} everywhere: expected an object on a transparent background")
    return cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA)


def _decoded(path: Path, flag: int) -> Array:
    """Return the pixels as OpenCV orders them; the errors leave out the file's name."""
    try:
        width, height = image_size(path)
    except InputError as error:
        raise InputError("cannot be read: expected a whole PNG or JPEG picture; save it again") from error
    if width * height > MAX_PIXELS:
        raise InputError(
            f"has {width} x {height} pixels: expected at most {MAX_PIXELS // 1_000_000} megapixels; scale it down"
        )
    content = path.read_bytes()
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flag) if _is_whole(content) else None
    if pixels is None:
        raise InputError("is truncated or damaged: expected a whole PNG or JPEG picture; copy it again")
    return pixels


def _is_whole(content: bytes) -> bool:
    """Return whether a file reaches the end of its picture: OpenCV fills what is missing with grey."""
    if content.startswith(PNG_SIGNATURE):
        return END_OF_PNG in content
    place = len(JPEG_SIGNATURE)
    while place + 4 <= len(content) and content[place + 1] != SCAN:
        place += 2 + int.from_bytes(content[place + 2 : place + 4], "big")
    return content.find(END_OF_JPEG, place) > 0  # an embedded preview, which has an end of its own, comes before
