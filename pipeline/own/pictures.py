"""Read photographs safely: the size is checked before decoding, and a truncated file is refused."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.own.csv_files import Faults, normal
from pipeline.runtime.errors import InputError
from pipeline.world.catalogue import MIN_VISIBLE_ALPHA
from pipeline.world.images import JPEG_SIGNATURE, PNG_SIGNATURE, image_size

SCENES, KINDS = "scenes", "kinds"  # folders with the pictures of tables, and with a folder of cut-outs for each kind
ENDINGS = (".jpg", ".jpeg", ".png")
MAX_PIXELS = 50_000_000  # 150 MB decoded; phones take 12 to 48 million
SQUARE_WITHIN = 0.02  # a picture of just the table is square within this share
END_OF_JPEG, END_OF_PNG = b"\xff\xd9", b"IEND"
SCAN = 0xDA  # the JPEG segment after which the pixels follow


def listed(folder: Path, *endings: str) -> list[Path]:
    """Return the files in a folder with one of these endings; hidden ones belong to the system, such as `._a.png`."""
    files = sorted(folder.iterdir())
    return [file for file in files if file.suffix.lower() in endings and not file.name.startswith(".")]


def scene_files(path: Path, faults: Faults) -> dict[str, Path]:
    """Return the picture of each scene in a folder by name, in the order of the names."""
    if not (path / SCENES).is_dir():
        faults.append(f"{SCENES}/ is missing: expected a folder with a picture of each scene")
        return {}
    scenes: dict[str, Path] = {}
    for file in listed(path / SCENES, *ENDINGS):
        name = normal(file.stem)
        if not name.isprintable():
            faults.append(f"{SCENES}/{file.name!r} has characters that cannot be printed: rename it")
        elif name in scenes:
            faults.append(f"{SCENES}/{file.name} and {scenes[name].name} are one scene {name!r}: rename one of them")
        else:
            scenes[name] = file
    if not scenes:
        faults.append(f"{SCENES}/ holds no picture: expected files that end in {', '.join(ENDINGS)}")
    return scenes


def is_square(width: int, height: int) -> bool:
    """Return whether a picture may show just the table."""
    return abs(width - height) <= SQUARE_WITHIN * max(width, height)


def read_picture(path: Path, name: str) -> UInt8[Array, "row column 3"]:
    """Return a photograph as RGB, turned upright as its EXIF data says.

    Raise InputError, which calls it `name`, if it is neither PNG nor JPEG, above MAX_PIXELS, or truncated.
    """
    return cv2.cvtColor(_decoded(path, name, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)


def read_cutout(path: Path, name: str) -> UInt8[Array, "row column 4"]:
    """Return a cut-out as RGBA with straight alpha.

    Raise InputError as `read_picture`, and if nothing in it is visible or everything opaque.
    """
    pixels = _decoded(path, name, cv2.IMREAD_UNCHANGED)
    if pixels.ndim != 3 or pixels.shape[2] != 4 or pixels.dtype != np.uint8:
        raise InputError(f"{name} has no transparent background: expected an 8-bit RGBA png; cut the object out")
    if (highest := pixels[..., 3].max()) <= MIN_VISIBLE_ALPHA:
        raise InputError(f"{name} has an alpha of at most {highest} of 255: expected 255 where the object is")
    if pixels[..., 3].min() == 255:
        raise InputError(f"{name} is opaque everywhere: expected an object on a transparent background")
    return cv2.cvtColor(pixels, cv2.COLOR_BGRA2RGBA)


def _decoded(path: Path, name: str, flag: int) -> Array:
    """Return the pixels as OpenCV orders them."""
    try:
        width, height = image_size(path)
    except InputError as error:
        raise InputError(f"{name} cannot be read: expected a whole PNG or JPEG picture; save it again") from error
    if width * height > MAX_PIXELS:
        most = f"{MAX_PIXELS // 1_000_000} megapixels"
        raise InputError(f"{name} has {width} x {height} pixels: expected at most {most}; scale it down")
    content = path.read_bytes()
    pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flag) if _is_whole(content) else None
    if pixels is None:
        raise InputError(f"{name} is truncated or damaged: expected a whole PNG or JPEG picture; copy it again")
    return pixels


def _is_whole(content: bytes) -> bool:
    """Return whether a file reaches the end of its picture: OpenCV fills what is missing with grey."""
    if content.startswith(PNG_SIGNATURE):
        return END_OF_PNG in content
    place = len(JPEG_SIGNATURE)
    while place + 4 <= len(content) and content[place + 1] != SCAN:
        place += 2 + int.from_bytes(content[place + 2 : place + 4], "big")
    return content.find(END_OF_JPEG, place) > 0  # an embedded preview, which has an end of its own, comes before
