"""Read pictures that people took, safely: what is damaged or huge is refused by a sentence."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.own import files
from pipeline.own.files import CUTOUTS, KINDS, Faults, Settings, normal
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


def read_cutouts(path: Path, settings: Settings | None, faults: Faults) -> dict[str, list[tuple[Array, float]]]:
    """Return each kind's cut-outs with the width of their pictures [m]; add a fault for a kind without one."""
    folders = {normal(folder.name): folder for folder in sorted(path.glob(f"{KINDS}/[!.]*/"))}
    if not (path / CUTOUTS).is_file():
        if folders:
            faults.append(f"{CUTOUTS} is missing: expected the columns kind, file, width_m and a row for each cut-out")
        return {}
    table = files.read_checked(path / CUTOUTS, None, faults)
    if table is None:
        return {}
    pictures = {(kind, normal(file.name)): file for kind in folders for file in files.listed(folders[kind], ".png")}
    cutouts: dict[str, list[tuple[Array, float]]] = {}
    side = files.SIDES_M[1] if settings is None else settings.size_m.max()
    for row, kind, file, width in table.itertuples(name=None):
        name = f"{KINDS}/{kind}/{file}"
        try:
            if (kind, file) not in pictures:
                raise InputError(f"{name} is missing: add the cut-out, or remove the row")
            if not 0 < width <= side:
                most = f"at most the table's longer side, {side:g}"
                raise InputError(f"width_m is {width:g}: expected the picture's width in metres, above 0 and {most}")
            cutouts.setdefault(kind, []).append((read_cutout(pictures[kind, file], name), width))
        except (InputError, OSError) as error:
            faults.append(f"{CUTOUTS}, row {row}: {error}")
    for kind in sorted(folders.keys() - {kind for kind, _ in pictures}):
        faults.append(f"{KINDS}/{kind} holds no cut-out: add a png with a transparent background, or remove it")
    for kind, file in sorted(pictures.keys() - set(zip(table["kind"], table["file"], strict=True))):
        faults.append(f"{KINDS}/{kind}/{file} has no row in {CUTOUTS}: add one with its width_m")
    return cutouts
