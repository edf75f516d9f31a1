"""Read and write scenes: images, layouts and appearances by pool, the position prior, and scenes with added items."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float, Int, UInt8
from numpy import ndarray as Array
from omegaconf import DictConfig

from pipeline.artifacts.files import read_arrays, read_table, write_arrays, write_table
from pipeline.runtime.errors import InputError
from pipeline.world.layout import EMPTY, SYMBOLS, Layouts, empty

LENGTHS = {"angle": "angle_rad", "scale": "scale", "half_length": "half_length_m", "radius": "radius_m"}  # column names
LAYOUT_COLUMNS = ["pool", "scene", "slot", "item", "symbol", "x_m", "y_m", *LENGTHS.values()]
APPEARANCE_COLUMNS = ["pool", "scene", "texture", "render_seed"]


@dataclass(frozen=True)
class SceneSet:
    """All scenes by pool (`train-s0`, ..., `new_scenes`, `new_items`, `val_scenes`, `val_items`).

    images: uint8 (scene, 100, 100, 3), row 0 at the far edge; layouts: the items and their positions;
    appearances: one row per scene with `texture` and `render_seed`.
    """

    images: dict[str, np.ndarray]
    layouts: dict[str, Layouts]
    appearances: dict[str, pd.DataFrame]

    def check_has(self, *pools: str) -> None:
        """Raise InputError for the first of these pools that is missing."""
        for pool in pools:
            if pool not in self.images:
                raise InputError(f"no scenes {pool}: there are {', '.join(self.images)}; run the scenes stage again")


def train_pool(seed: int) -> str:
    """Return the pool name of a seed's training scenes."""
    return f"train-s{seed}"


def write_scenes(out_dir: Path, scenes: SceneSet) -> None:
    """Write images.npz, layouts.parquet and appearance.parquet."""
    write_arrays(out_dir / "images.npz", scenes.images)
    write_table(out_dir / "layouts.parquet", pd.concat([layout_table(p, x) for p, x in scenes.layouts.items()]))
    looks = [x.assign(pool=p, scene=range(len(x)))[APPEARANCE_COLUMNS] for p, x in scenes.appearances.items()]
    write_table(out_dir / "appearance.parquet", pd.concat(looks))


def read_scenes(directory: Path) -> SceneSet:
    """Return the scenes written by `write_scenes`; raise InputError if the three files disagree."""
    images = read_arrays(directory / "images.npz")
    rows = read_table(directory / "layouts.parquet", LAYOUT_COLUMNS)
    appearance = read_table(directory / "appearance.parquet", APPEARANCE_COLUMNS)
    slots = int(rows["slot"].max()) + 1 if len(rows) else 1
    by_pool = {pool: part for pool, part in rows.groupby("pool")}
    appearances = {p: x[["texture", "render_seed"]].reset_index(drop=True) for p, x in appearance.groupby("pool")}
    if set(by_pool) != set(images) or set(appearances) != set(images):
        raise InputError(f"{directory}: images, layouts and appearance name different pools; rerun stage scenes")
    for pool, array in images.items():
        count = len(appearances[pool])
        if array.dtype != np.uint8 or array.shape[1:] != (100, 100, 3) or len(array) != count:
            found = f"{directory}: pool {pool} holds {array.dtype} images {array.shape}, {count} scenes"
            raise InputError(f"{found}; expected uint8 (scene, 100, 100, 3); run its stage again")
    # One slot more than any scene uses leaves room for an added item.
    layouts = {pool: padded_layouts(by_pool[pool], len(images[pool]), slots + 1) for pool in images}
    return SceneSet(images, layouts, appearances)


def read_position_prior(directory: Path) -> dict[str, np.ndarray]:
    """Return each user's mean true validity over z_theta, (side, side) as [y, x] on `bezier.lattice(side)`."""
    return read_arrays(directory / "position_prior.npz")


def layout_table(pool: str, layouts: Layouts) -> pd.DataFrame:
    """Return one row per placed item."""
    scene, slot = index = np.nonzero(layouts.present)
    table = pd.DataFrame({"pool": pool, "scene": scene, "slot": slot})
    table["item"], table["symbol"] = layouts.item[index], layouts.symbol[index]
    table[["x_m", "y_m"]] = layouts.centre[index]
    return table.assign(**{column: getattr(layouts, name)[index] for name, column in LENGTHS.items()})


def padded_layouts(rows: pd.DataFrame, scenes: int, slots: int) -> Layouts:
    """Return the layouts described by rows of `layout_table`, padded to `slots`."""
    layouts = empty(scenes, slots)
    index = rows["scene"].to_numpy(), rows["slot"].to_numpy()
    if len(rows) and (index[0].max() >= scenes or (rows["symbol"] == EMPTY).any()):
        raise InputError("layouts name a scene without an image or an item without a symbol; rerun stage scenes")
    layouts.item[index], layouts.symbol[index] = rows["item"], rows["symbol"]
    layouts.centre[index] = rows[["x_m", "y_m"]].to_numpy()
    for name, column in LENGTHS.items():
        getattr(layouts, name)[index] = rows[column]
    return layouts


@dataclass(frozen=True)
class AddedItems:
    """The first placement of each symbol in every scene of a pool, by stage intervene."""

    images: UInt8[Array, "symbol scene 100 100 3"]
    layouts: list[Layouts]  # by symbol; the added item is in the last occupied slot

    @property
    def placed(self) -> list[Layouts]:
        """Return the added items alone, as layouts (scene, 1) by symbol."""
        return [x[np.arange(len(x))[:, None], x.present.sum(1)[:, None] - 1] for x in self.layouts]

    @property
    def item(self) -> Int[Array, "symbol scene"]:
        """Return the added items as rows of items.csv."""
        return np.stack([x.item[:, 0] for x in self.placed])


def read_interventions(directory: Path, scenes: Layouts) -> AddedItems:
    """Read the outputs of stage intervene, with layouts padded to the slots of `scenes`.

    InputError if images and layouts disagree, or if the items were added to other scenes.
    """
    images = read_arrays(directory / "images.npz")["images"][:, 0]
    rows = read_table(directory / "layouts.parquet", LAYOUT_COLUMNS)
    slots, present, layouts = scenes.symbol.shape[1], np.nonzero(scenes.present), []
    for symbol in SYMBOLS:
        placed = rows[(rows["pool"] == f"{symbol}-0") & (rows["slot"] < slots)]
        layout = padded_layouts(placed, images.shape[1], slots)
        one_more = len(layout) == len(scenes) and (layout.present.sum(1) == scenes.present.sum(1) + 1).all()
        if not (one_more and np.array_equal(layout.centre[present], scenes.centre[present])):
            again = "run the intervene stage again, for the same intervene.split"
            raise InputError(f"{directory}: not these scenes with an added {symbol} in each; {again}")
        layouts.append(layout)
    return AddedItems(images, layouts)


class Versions(NamedTuple):
    """Scenes as they are (version 0) and with symbol k added (version 1 + k), with random paths in them."""

    images: UInt8[Array, "version scene 100 100 3"]
    layouts: list[Layouts]
    z_theta: Float[Array, "scene path 2"]  # [m]


def read_versions(cfg: DictConfig, scenes: SceneSet, count: int) -> Versions:
    """Return the first `count` scenes that stage intervene added items to; InputError as of `read_interventions`."""
    pool, folder = cfg.protocol.splits[cfg.intervene.split], Path(cfg.paths.intervene)
    added = read_interventions(folder, scenes.layouts[pool])
    images = np.concatenate([scenes.images[pool][None, :count], added.images[:, :count]])
    layouts = [x[:count] for x in (scenes.layouts[pool], *added.layouts)]
    return Versions(images, layouts, read_arrays(folder / "images.npz")["z_theta"][:count])
