"""Read and write image files with OpenCV; an unusable file raises a one-sentence InputError."""

import os
import re
from pathlib import Path
from tempfile import TemporaryFile
from threading import Lock
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError

MAX_SIDE_PX = 4096  # largest allowed side: 64 MB as RGBA; larger images are refused before decoding
PNG_SIGNATURE, JPEG_SIGNATURE = b"\x89PNG\r\n\x1a\n", b"\xff\xd8"  # first bytes of the files
JPEG_FRAME_MARKERS = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # segments that contain the image size
DAMAGE = re.compile(r"Corrupt JPEG data: (?!\d{1,2} extraneous bytes before marker 0xd9).*|libpng error.*")
_one_decoder = Lock()  # as it takes descriptor 2

_log: Any = getattr(cv2.utils, "logging", cv2)  # Blender's OpenCV is version 4
_log.setLogLevel(0)  # silent: this module reports the errors itself


def image_size(path: Path) -> tuple[int, int]:
    """Return width and height [px] of a PNG or JPEG file from its header, without decoding it.

    Raises InputError if the file is missing, or neither PNG nor JPEG.
    """
    if not path.is_file():
        raise InputError(f"{path} is missing: restore it, or correct the name")
    with path.open("rb") as file:
        head = file.read(24)
        if head.startswith(PNG_SIGNATURE) and len(head) == 24:
            return int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
        if head.startswith(JPEG_SIGNATURE):
            file.seek(2)
            while len(segment := file.read(9)) == 9 and segment[0] == 0xFF:
                if segment[1] in JPEG_FRAME_MARKERS:
                    return int.from_bytes(segment[7:9], "big"), int.from_bytes(segment[5:7], "big")
                file.seek(int.from_bytes(segment[2:4], "big") - 7, 1)
    raise InputError(f"{path} is truncated or not a PNG or JPEG image: restore or replace it")


def decode(path: Path, flag: int) -> tuple[Array | None, str]:
    """Return the pixels as OpenCV gives them, None if there are none, and what the decoder says is damaged."""
    with _one_decoder, TemporaryFile() as said:  # libjpeg and libpng write their warnings to descriptor 2
        before = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            pixels = cv2.imdecode(np.fromfile(path, np.uint8), flag)
        finally:
            os.dup2(before, 2)
            os.close(before)
        said.seek(0)
        damage = DAMAGE.search(said.read().decode("ascii", "replace"))
    return pixels, damage[0] if damage else ""


def read_image(path: Path) -> UInt8[Array, "row column channel"]:
    """Return an image as RGB, or as RGBA (straight alpha) if the file has an alpha channel.

    Raises InputError if the file is missing, neither PNG nor JPEG, larger than MAX_SIDE_PX per side, or truncated.
    """
    width, height = image_size(path)
    if max(width, height) > MAX_SIDE_PX:
        raise InputError(f"{path} is {width} x {height} pixels: expected at most {MAX_SIDE_PX} a side; scale it down")
    pixels, damage = decode(path, cv2.IMREAD_UNCHANGED)
    if pixels is None or damage:
        raise InputError(f"{path} is truncated or damaged: expected a whole PNG or JPEG image; restore or replace it")
    if pixels.dtype != np.uint8:
        raise InputError(f"{path} has {pixels.dtype} values: expected 8 bits a channel; save it as such")
    if pixels.ndim == 2:
        return cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB)
    return cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA if pixels.shape[-1] == 4 else cv2.COLOR_BGR2RGB)


def write_png(path: Path, pixels: UInt8[Array, "row column channel"]) -> None:
    """Write an RGB or RGBA image as a PNG file at the highest compression."""
    colours = cv2.cvtColor(pixels, cv2.COLOR_RGBA2BGRA if pixels.shape[-1] == 4 else cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(".png", colours, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    path.write_bytes(encoded.tobytes())
