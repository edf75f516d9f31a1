"""One user's demonstrations as the library takes them."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray as Array

from pipeline.own.folder import Folder
from pipeline.own.frame import without_pattern


@dataclass(frozen=True)
class UserData:
    """A user's scenes with the same number of demonstrations each: where there are fewer, they repeat in turn.

    So each scene counts the same in a fit. `real` marks those that are no repetition: only they are scored.
    """

    user: str
    scenes: list[str]
    images: UInt8[Array, "scene 100 100 3"]
    z_theta: Float[Array, "scene n 2"]  # [m of the model]
    valid: Bool[Array, "scene n"]
    real: Bool[Array, "scene n"]
    row: Int[Array, "scene n"]  # of the table of demonstrations


def model_images(folder: Folder) -> dict[str, UInt8[Array, "100 100 3"]]:
    """Return the image of each scene that the models see."""
    images = {scene: folder.frame.image(canvas) for scene, canvas in folder.canvases.items()}
    return dict(zip(images, plain(folder, np.stack(list(images.values()))), strict=True))


def plain(folder: Folder, images: UInt8[Array, "scene 100 100 3"]) -> UInt8[Array, "scene 100 100 3"]:
    """Return images without the table's pattern, where there is a picture of the empty table."""
    return images if folder.empty is None else without_pattern(images, folder.frame.image(folder.empty))


def user_data(user: str, demos: pd.DataFrame, images: dict[str, Array]) -> UserData:
    """Return one user's demonstrations as arrays, scenes in the order of their names."""
    rows = {scene: part.index.to_numpy() for scene, part in demos[demos["user"] == user].groupby("scene", sort=True)}
    n = max(map(len, rows.values()))
    index = np.stack([np.resize(part, n) for part in rows.values()])
    return UserData(
        user,
        list(rows),
        np.stack([images[scene] for scene in rows]),
        demos[["z_x", "z_y"]].to_numpy()[index],
        demos["valid"].to_numpy(bool)[index],
        np.arange(n) < np.array([len(part) for part in rows.values()])[:, None],
        index,
    )
