"""Scenes as stages exchange them: images, layouts and looks by pool, and the position prior."""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.artifacts.files import read_arrays, read_table, write_arrays, write_table
from pipeline.runtime.errors import InputError
from pipeline.world.layout import EMPTY, Layouts, empty

LAYOUT_COLUMNS = [
    "pool",
    "scene",
    "slot",
    "item",
    "symbol",
    "x_m",
    "y_m",
    "angle_rad",
    "scale",
    "half_length_m",
    "radius_m",
]
LOOK_COLUMNS = ["pool", "scene", "texture", "render_seed"]


@dataclass(frozen=True)
class SceneSet:
    """Every scene by pool (`train-s0`, ..., `new_scenes`, `new_items`, `val_scenes`, `val_items`).

    images: uint8 (scene, 100, 100, 3), row 0 at the far edge; layouts: what stands where;
    looks: one row a scene with its `texture` and `render_seed`.
    """

    images: dict[str, np.ndarray]
    layouts: dict[str, Layouts]
    looks: dict[str, pd.DataFrame]

    def check_has(self, *pools: str) -> None:
        """Raise InputError for the first of these pools that is missing."""
        for pool in pools:
            if pool not in self.images:
                raise InputError(f"no scenes {pool}: there are {', '.join(self.images)}; run the scenes stage again")


def train_pool(seed: int) -> str:
    """The pool of a seed's own training scenes."""
    return f"train-s{seed}"


def write_scenes(out_dir: Path, scenes: SceneSet) -> None:
    """Write images.npz, layouts.parquet and looks.parquet."""
    write_arrays(out_dir / "images.npz", scenes.images)
    write_table(out_dir / "layouts.parquet", pd.concat([layout_table(p, x) for p, x in scenes.layouts.items()]))
    looks = [look.assign(pool=pool, scene=range(len(look)))[LOOK_COLUMNS] for pool, look in scenes.looks.items()]
    write_table(out_dir / "looks.parquet", pd.concat(looks))


def read_scenes(directory: Path) -> SceneSet:
    """What `write_scenes` wrote; InputError if the three files disagree."""
    images = read_arrays(directory / "images.npz")
    rows = read_table(directory / "layouts.parquet", LAYOUT_COLUMNS)
    looks = read_table(directory / "looks.parquet", LOOK_COLUMNS)
    slots = int(rows["slot"].max()) + 1 if len(rows) else 1
    by_pool = {pool: part for pool, part in rows.groupby("pool")}
    look_by_pool = {
        pool: part[["texture", "render_seed"]].reset_index(drop=True) for pool, part in looks.groupby("pool")
    }
    if set(by_pool) != set(images) or set(look_by_pool) != set(images):
        raise InputError(f"{directory}: images, layouts and looks name different pools; run the scenes stage again")
    for pool, array in images.items():
        if array.dtype != np.uint8 or array.shape[1:] != (100, 100, 3) or len(array) != len(look_by_pool[pool]):
            raise InputError(
                f"{directory}: pool {pool} holds {array.dtype} images {array.shape}, "
                f"{len(look_by_pool[pool])} scenes; expected uint8 (scene, 100, 100, 3); run its stage again"
            )
    layouts = {pool: _layouts(by_pool[pool], len(images[pool]), slots + 1) for pool in images}
    return SceneSet(images, layouts, look_by_pool)


def read_position_prior(directory: Path) -> dict[str, np.ndarray]:
    """Per user the true mean validity over z_theta, (side, side) as [y, x] on `bezier.lattice(side)`."""
    return read_arrays(directory / "position_prior.npz")


def layout_table(pool: str, layouts: Layouts) -> pd.DataFrame:
    """One row per placed item."""
    scene, slot = np.nonzero(layouts.present)
    values = {f.name: getattr(layouts, f.name)[scene, slot] for f in fields(layouts)}
    columns = [
        pool,
        scene,
        slot,
        values["item"],
        values["symbol"],
        values["centre"][:, 0],
        values["centre"][:, 1],
        values["angle"],
        values["scale"],
        values["half_length"],
        values["radius"],
    ]
    return pd.DataFrame(dict(zip(LAYOUT_COLUMNS, columns, strict=True)))


def _layouts(rows: pd.DataFrame, scenes: int, slots: int) -> Layouts:
    """Rows back to padded arrays, with one free slot more than any scene uses."""
    layouts = empty(scenes, slots)
    at = rows["scene"].to_numpy(), rows["slot"].to_numpy()
    if len(rows) and (at[0].max() >= scenes or (rows["symbol"] == EMPTY).any()):
        raise InputError(
            "layouts name a scene without an image or an item without a symbol; run the scenes stage again"
        )
    layouts.item[at], layouts.symbol[at] = rows["item"], rows["symbol"]
    layouts.centre[at] = rows[["x_m", "y_m"]].to_numpy()
    for name, column in (
        ("angle", "angle_rad"),
        ("scale", "scale"),
        ("half_length", "half_length_m"),
        ("radius", "radius_m"),
    ):
        getattr(layouts, name)[at] = rows[column]
    return layouts
