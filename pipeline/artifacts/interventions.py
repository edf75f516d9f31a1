"""Scenes with one more item in them, as stage intervene draws them."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from jaxtyping import Int, UInt8
from numpy import ndarray as Array

from pipeline.artifacts.files import read_arrays, read_table
from pipeline.artifacts.scenes import LAYOUT_COLUMNS
from pipeline.runtime.errors import InputError
from pipeline.world.layout import SYMBOLS, Layouts, empty


@dataclass(frozen=True)
class AddedItems:
    """The first placement of each symbol in every scene of the pool that was intervened on."""

    images: UInt8[Array, "symbol scene 100 100 3"]
    layouts: list[Layouts]  # by symbol; the added item stands in the last slot taken

    @property
    def placed(self) -> list[Layouts]:
        """The added item of each scene by itself, (scene, 1), by symbol."""
        return [_last(x) for x in self.layouts]

    @property
    def item(self) -> Int[Array, "symbol scene"]:
        """Which one was added (row of items.csv)."""
        return np.stack([x.item[:, 0] for x in self.placed])


def _last(layouts: Layouts) -> Layouts:
    slot, at = layouts.present.sum(1) - 1, np.arange(len(layouts))
    return Layouts(*(getattr(layouts, f.name)[at, slot][:, None] for f in fields(layouts)))


def read_interventions(directory: Path, scenes: Layouts) -> AddedItems:
    """What stage intervene wrote, its layouts padded as those of the `scenes` are.

    InputError if pictures and layouts disagree, or if it was to other scenes that an item was added.
    """
    slots, own = scenes.symbol.shape[1], np.nonzero(scenes.present)
    images = read_arrays(directory / "images.npz")["images"][:, 0]
    rows = read_table(directory / "layouts.parquet", LAYOUT_COLUMNS)
    layouts = []
    for symbol in SYMBOLS:
        placed = rows[rows["pool"] == f"{symbol}-0"]
        layout = empty(images.shape[1], slots)
        if set(placed["scene"]) != set(range(len(layout))) or placed["slot"].max() >= slots:
            raise InputError(
                f"{directory}: {images.shape[1]} pictures of scenes with one more {symbol}, layouts of "
                f"{placed['scene'].nunique()} with up to {slots} items; run the intervene stage again"
            )
        at = placed["scene"].to_numpy(), placed["slot"].to_numpy()
        layout.item[at], layout.symbol[at] = placed["item"], placed["symbol"]
        layout.centre[at] = placed[["x_m", "y_m"]].to_numpy()
        layout.angle[at], layout.scale[at] = placed["angle_rad"], placed["scale"]
        layout.half_length[at], layout.radius[at] = placed["half_length_m"], placed["radius_m"]
        one_more = len(layout) == len(scenes) and (layout.present.sum(1) == scenes.present.sum(1) + 1).all()
        if not (one_more and np.array_equal(layout.centre[own], scenes.centre[own])):
            raise InputError(
                f"{directory}: not the scenes asked about with one more {symbol} in each; run the intervene stage "
                "again, for the same intervene.split"
            )
        layouts.append(layout)
    return AddedItems(images, layouts)
