"""A picture of a recording as a file: PNG, whose text says which recording it shows and what that held."""

from dataclasses import dataclass
from pathlib import Path

from PIL import Image, UnidentifiedImageError
from PIL.PngImagePlugin import PngInfo

from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

RECORDING, CONTENTS = "Recording", "Contents"


@dataclass(frozen=True)
class Screenshot:
    """Rerun's viewer, open on a recording."""

    image: Image.Image  # RGB
    recording: str  # its name
    contents: str  # its digest (pipeline.viewer.digest) when the picture was made


def write_png(path: Path, shot: Screenshot) -> None:
    """Write the picture and what it shows."""
    said = PngInfo()
    said.add_text(RECORDING, shot.recording)
    said.add_text(CONTENTS, shot.contents)
    atomic_write(path, lambda part: shot.image.save(part, "PNG", optimize=True, pnginfo=said))


def read_png(path: Path) -> Screenshot:
    """What `write_png` wrote; InputError if the file is none of its."""
    try:
        with Image.open(path, formats=["PNG"]) as image:
            said = image.info
            return Screenshot(image.convert("RGB"), said[RECORDING], said[CONTENTS])
    except (UnidentifiedImageError, Image.DecompressionBombError, OSError, KeyError) as error:
        raise InputError(
            f"{path} is not a picture of a recording ({error}): run `make pictures` to draw it anew"
        ) from error
