"""Read a folder that `python -m making.render` wrote, without Blender."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.runtime.errors import InputError
from pipeline.world.images import read_image
from pipeline.world.layout import SIDE, SYMBOLS, Layouts, empty

SLOTS = 4  # of a layout: three items and an added one
PER_ROW = 10  # pictures in a row of a contact sheet


class Rendered(NamedTuple):
    """Hold a split of rendered scenes; all lists are in the order of the scenes."""

    images: UInt8[Array, "scene 100 100 3"]
    empty: UInt8[Array, "scene 100 100 3"]  # the same tables without items
    with_item: dict[str, Array]  # symbol -> the same scenes with one item added; empty for split train
    layouts: Layouts  # true footprints
    layouts_with_item: dict[str, Layouts]
    tops: list[str]  # kind of table top


def sheet(images: UInt8[Array, "scene 100 100 3"]) -> UInt8[Array, "row column 3"]:
    """Return a contact sheet of the pictures, PER_ROW in a row, black where there are none."""
    rows = -(-len(images) // PER_ROW)
    padded = np.zeros((rows * PER_ROW, SIDE, SIDE, 3), np.uint8)
    padded[: len(images)] = images
    return padded.reshape(rows, PER_ROW, SIDE, SIDE, 3).swapaxes(1, 2).reshape(rows * SIDE, PER_ROW * SIDE, 3)


def pictures(pixels: UInt8[Array, "row column 3"]) -> UInt8[Array, "place 100 100 3"]:
    """Return the pictures of a contact sheet, the black ones at its end included."""
    rows = len(pixels) // SIDE
    return np.ascontiguousarray(pixels.reshape(rows, SIDE, PER_ROW, SIDE, 3).swapaxes(1, 2)).reshape(-1, SIDE, SIDE, 3)


def _pictures(path: Path, scenes: int) -> UInt8[Array, "scene 100 100 3"]:
    """Return the pictures of a contact sheet."""
    pixels = read_image(path)
    expected = sheet(np.zeros((scenes, SIDE, SIDE, 3), np.uint8)).shape
    if pixels.shape != expected:
        raise InputError(f"{path} has shape {pixels.shape}: expected {expected} for {scenes} scenes; render it again")
    return pictures(pixels)[:scenes]


def read_rendered(folder: Path) -> Rendered:
    """Read pictures, footprints and kinds of table top of one split, e.g. rendered/pictures/validation_taught.

    Raises InputError if a file is missing or a picture has the wrong size.
    """
    for name in ("scenes.csv", "items.csv"):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder / name} is missing: run `dvc pull --remote store rendered/pictures.dvc` or `make render`"
            )
    scenes, items = pd.read_csv(folder / "scenes.csv"), pd.read_csv(folder / "items.csv")
    count = len(scenes)
    symbols = [symbol for symbol in SYMBOLS if (items["added"] & (items["symbol"] == symbol)).any()]
    images = _pictures(folder / "scene.png", count)
    return Rendered(
        images,
        _pictures(folder / "empty.png", count),
        {symbol: images + _pictures(folder / f"{symbol}.png", count) for symbol in symbols},  # uint8: modulo 256
        _layouts(items[~items["added"]], count),
        {s: _layouts(items[~items["added"] | (items["symbol"] == s)], count) for s in symbols},
        scenes["top"].tolist(),
    )


def _layouts(items: pd.DataFrame, scenes: int) -> Layouts:
    """Return the layouts of rows of items.csv."""
    layouts = empty(scenes, SLOTS)
    place = items["scene"].to_numpy(), items["slot"].to_numpy()
    layouts.symbol[place] = [SYMBOLS.index(symbol) for symbol in items["symbol"]]
    layouts.centre[place] = items[["x", "y"]].to_numpy()
    for name in ("item", "angle", "scale", "half_length", "radius"):
        getattr(layouts, name)[place] = items[name].to_numpy()
    return layouts
