"""The pictures of scenes: which there are, how large, and new ones from a person's files."""

import io
import re
import unicodedata
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from pipeline.own.recorder.tables import write_durably
from pipeline.runtime.errors import InputError

FORMATS = {"JPEG": ".jpg", "PNG": ".png"}
SUFFIXES = (".jpg", ".jpeg", ".png")
MAX_UPLOAD_BYTES = 25_000_000  # of one picture; a phone's has some 5 MB
MAX_PIXELS = 50_000_000  # of one picture; 150 MB as RGB


def list_scenes(folder: Path) -> dict[str, Path]:
    """Return the pictures in `folder`/scenes by the name of their scene, in the order of names.

    Raise InputError for a link that leads out of the folder and for two pictures of one name.
    """
    scenes: dict[str, Path] = {}
    for path in sorted((folder / "scenes").glob("*")):
        if path.suffix.lower() not in SUFFIXES or path.name.startswith("."):
            continue
        inside(folder, path)
        if path.stem in scenes:
            raise InputError(f"scenes/{path.name} and scenes/{scenes[path.stem].name} are one scene: rename one")
        scenes[path.stem] = path
    return scenes


def inside(folder: Path, path: Path) -> Path:
    """Return `path`; raise InputError if it leads out of the folder, as a symbolic link can."""
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{path.relative_to(folder)} leads out of the folder: replace the link by a copy of the file")
    return path


def picture_size(path: Path) -> tuple[int, int]:
    """Return width and height [px] as shown, that is, turned as the camera was held."""
    try:
        with Image.open(path) as image:
            turned = image.getexif().get(0x0112, 1) in (5, 6, 7, 8)
            size = image.size[::-1] if turned else image.size
    except (UnidentifiedImageError, OSError, Image.DecompressionBombError) as error:
        raise InputError(f"scenes/{path.name} is no readable picture: replace or remove it") from error
    if size[0] * size[1] > MAX_PIXELS:
        raise InputError(f"scenes/{path.name} has {size[0]} x {size[1]} pixels: at most {MAX_PIXELS // 10**6} million")
    return size


def import_picture(folder: Path, file_name: str, content: bytes) -> str:
    """Store a JPEG or PNG as a new scene and return its name, derived from that of the file.

    Raise InputError if the content is no such picture, is too large, or the name is taken.
    """
    name = scene_name(file_name)
    suffix = _checked_format(file_name, content)
    if name in list_scenes(folder):
        raise InputError(f"there is a scene {name} already: rename the file, or remove the earlier picture")
    path = inside(folder, folder / "scenes" / f"{name}{suffix}")
    write_durably(path, lambda temporary: temporary.write_bytes(content))
    return name


def scene_name(file_name: str) -> str:
    """Return the name of a scene from that of a file: letters, digits, dots, hyphens and underscores of any script."""
    stem = unicodedata.normalize("NFC", Path(file_name.replace("\\", "/")).stem)
    name = re.sub(r"[^\w.-]+", "_", stem).strip("._-")[:80]
    if not name:
        raise InputError(f"the file name {file_name!r} holds no letter or digit: rename the file")
    return name


def _checked_format(file_name: str, content: bytes) -> str:
    """Return the suffix of a picture's format after decoding it once."""
    try:
        with Image.open(io.BytesIO(content), formats=list(FORMATS)) as image:
            suffix, pixels = FORMATS[image.format or ""], image.size[0] * image.size[1]
    except (UnidentifiedImageError, OSError, KeyError, Image.DecompressionBombError) as error:
        raise InputError(f"{file_name} is no JPEG or PNG picture: export it as one of these") from error
    if pixels > MAX_PIXELS:
        raise InputError(f"{file_name} has more than {MAX_PIXELS // 10**6} million pixels: scale it down")
    if cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_8) is None:
        raise InputError(f"{file_name} is damaged: export the picture again")
    return suffix
