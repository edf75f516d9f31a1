"""Scenes, and one user's demonstrations, as the library takes them."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array

from pipeline.models.base import to_tensor
from pipeline.own.folder import Folder
from pipeline.own.frame import Frame, outline
from pipeline.perception.objects import Objects, detect_objects
from pipeline.world.layout import point_segment_distance

NEAR_M = 0.01  # an item's centre may lie this far outside a detected outline [m of the model]


@dataclass(frozen=True)
class Scenes:
    """All pictures as the models see them, with the detected objects."""

    names: list[str]
    images: UInt8[Array, "scene 100 100 3"]
    objects: Objects

    @classmethod
    def of(cls, folder: Folder) -> "Scenes":
        """Return the scenes of a folder."""
        images = np.stack([folder.image(canvas) for canvas in folder.canvases.values()])
        return cls(list(folder.canvases), images, detect_objects(to_tensor(images)))

    def detected(self, items: pd.DataFrame, frame: Frame) -> tuple[pd.DataFrame, int]:
        """Return one row for each listed item: scene, kind, and whether a detected object covers its centre.

        The number counts the detected objects that cover no listed item, in the scenes that have listed items.
        """
        centres, hits, unlisted = frame.to_model(items[["x", "y"]].to_numpy()), np.zeros(len(items), bool), 0
        for name, rows in items.groupby("scene").indices.items():
            scene = self.names.index(str(name))
            present = self.objects.present[scene]
            ends = self.objects.ends[scene, present].astype(float)[:, None]
            away = point_segment_distance(centres[rows], ends[..., 0, :], ends[..., 1, :])  # (object, item)
            near = away - self.objects.radius[scene, present][:, None] < NEAR_M
            hits[rows] = near.any(0)
            unlisted += int((~near.any(1)).sum())
        return items[["scene", "kind"]].assign(detected=hits), unlisted

    def outlines(self, scene: int) -> list[Float[Array, "point 2"]]:
        """Return the outlines [m] of the objects that were detected in a scene."""
        present = self.objects.present[scene]
        capsules = zip(self.objects.ends[scene, present], self.objects.radius[scene, present], strict=True)
        return [outline(ends, radius) for ends, radius in capsules]


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
    demo: Array  # names (scene, n)

    @classmethod
    def of(cls, user: str, demos: pd.DataFrame, scenes: Scenes) -> "UserData":
        """Return one user's demonstrations, scenes in the order of their names."""
        demos = demos[demos["user"] == user].reset_index(drop=True)
        rows = {str(scene): part.index for scene, part in demos.groupby("scene")}
        counts = np.array([len(part) for part in rows.values()])
        index = np.stack([np.resize(part, counts.max()) for part in rows.values()])
        return cls(
            user,
            list(rows),
            scenes.images[[scenes.names.index(scene) for scene in rows]],
            demos[["z_x", "z_y"]].to_numpy()[index],
            demos["valid"].to_numpy(bool)[index],
            np.arange(counts.max()) < counts[:, None],
            demos["demo"].to_numpy(object)[index],
        )
