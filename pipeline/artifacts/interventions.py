"""Read the scenes with an added item that stage intervene rendered."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Int, UInt8
from numpy import ndarray as Array

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import LAYOUT_COLUMNS, padded_layouts
from pipeline.runtime.errors import InputError
from pipeline.world.layout import SYMBOLS, Layouts


@dataclass(frozen=True)
class AddedItems:
    """The first placement of each symbol in every scene of the pool."""

    images: UInt8[Array, "symbol scene 100 100 3"]
    layouts: list[Layouts]  # by symbol; the added item is in the last occupied slot

    @property
    def placed(self) -> list[Layouts]:
        """Return the added items alone, as layouts (scene, 1) by symbol."""
        return [_last(x) for x in self.layouts]

    @property
    def item(self) -> Int[Array, "symbol scene"]:
        """Return the added items as rows of items.csv."""
        return np.stack([x.item[:, 0] for x in self.placed])


def _last(layouts: Layouts) -> Layouts:
    slot, scene = layouts.present.sum(1) - 1, np.arange(len(layouts))
    return Layouts(*(getattr(layouts, f.name)[scene, slot][:, None] for f in fields(layouts)))


def read_interventions(directory: Path, scenes: Layouts) -> AddedItems:
    """Read the outputs of stage intervene, with layouts padded to the slots of `scenes`.

    InputError if images and layouts disagree, or if the items were added to other scenes.
    """
    slots, present = scenes.symbol.shape[1], np.nonzero(scenes.present)
    images = read_arrays(directory / "images.npz")["images"][:, 0]
    rows = read_table(directory / "layouts.parquet", LAYOUT_COLUMNS)
    layouts = []
    for symbol in SYMBOLS:
        placed = rows[rows["pool"] == f"{symbol}-0"]
        if set(placed["scene"]) != set(range(images.shape[1])) or placed["slot"].max() >= slots:
            raise InputError(
                f"{directory}: {images.shape[1]} images of scenes with an added {symbol}, layouts of "
                f"{placed['scene'].nunique()} with up to {slots} items; run the intervene stage again"
            )
        layout = padded_layouts(placed, images.shape[1], slots)
        one_more = len(layout) == len(scenes) and (layout.present.sum(1) == scenes.present.sum(1) + 1).all()
        if not (one_more and np.array_equal(layout.centre[present], scenes.centre[present])):
            raise InputError(
                f"{directory}: not these scenes with an added {symbol} in each; run the intervene stage again, for the "
                "same intervene.split"
            )
        layouts.append(layout)
    return AddedItems(images, layouts)
