"""Boards: tables and maps of a run side by side in one view, in panels of the table's size (see `geometry`)."""

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from pipeline.viewer.geometry import TABLE_PIXELS, corner
from pipeline.viewer.scene import ITEM, log_table_edge, table_edge

Panel = tuple[int, int]  # row, column
TITLE = np.array([TABLE_PIXELS / 2, -7.0])  # from a panel's corner to its title

# A new scene: what stands there, what the model and the truth say, and where they differ.
SCENE_MAPS = {"predicted": (0, 1), "truth": (0, 2), "difference": (0, 3)}
SCENE_TITLES = {(0, 0): "Table", (0, 1): "Model's p(valid)", (0, 2): "Truth", (0, 3): "Difference: model - truth"}


def panel(at: Panel, side: int) -> rr.Transform3D:
    """Where an entity of `side` units a side, and all below it, lies on its board."""
    x, y = corner(*at)
    return rr.Transform3D(translation=[x, y, 0], scale=TABLE_PIXELS / side)


def log_titles(
    recording: rr.RecordingStream, entity: str, titles: Mapping[Panel, str], maps: Sequence[Panel] = ()
) -> None:
    """A title over each panel, and the table's edge in those that are maps."""
    above = [corner(*at) + TITLE for at in titles]
    labels = rr.Points2D(above, labels=list(titles.values()), colors=ITEM, radii=0)
    recording.log(f"{entity}/titles", labels, static=True)
    if maps:
        log_table_edge(recording, entity, np.stack([table_edge(TABLE_PIXELS) + corner(*at) for at in maps]), 0.3)
