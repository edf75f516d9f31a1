"""What every recording is made of: the file itself, a scene on the table, a map over z_theta.

A scene and its maps are logged at the time that is set, or for all times if none is.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Bool, UInt8
from numpy import ndarray as Array

from pipeline.recording.geometry import boundary, footprints, kept_clear, map_image, on_map, on_table
from pipeline.table.bezier import P_F, P_INIT
from pipeline.table.layout import Layouts

APPLICATION = "causal-specifications"

# Okabe and Ito's colours, which people with any colour vision tell apart.
VALID, INVALID = (0, 158, 255), (230, 97, 0)
ITEM, KEPT_CLEAR = (255, 255, 255), (255, 255, 255, 110)
BOUNDARY, TABLE_EDGE = (213, 0, 120), (0, 150, 170)


@contextmanager
def recording_at(path: Path, name: str, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """A recording called `name`, written to `path` with `blueprint` saved inside; the process holds none afterwards."""
    recording = rr.RecordingStream(APPLICATION, recording_id=name, send_properties=False)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    recording.save(path, default_blueprint=blueprint)
    recording.send_recording_name(name)
    yield recording
    recording.flush()
    recording.disconnect()


def log_page(recording: rr.RecordingStream, markdown: str) -> None:
    """The page beside the views."""
    recording.log("readme", rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)


def log_fixed(recording: rr.RecordingStream, side: int) -> None:
    """What is the same in every scene: both ends of every path, and where the table lies in a map of `side` cells."""
    ends = on_table(np.stack([P_INIT, P_F]))
    recording.log("fixed/ends", rr.Points2D(ends, labels=["start", "goal"], colors=ITEM, radii=1.2), static=True)
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float)
    edge = on_map(corners, side)
    recording.log("fixed/table_edge", rr.LineStrips2D([edge], colors=TABLE_EDGE, radii=0.12), static=True)


def log_table(
    recording: rr.RecordingStream,
    entity: str,
    image: UInt8[Array, "100 100 3"],
    layout: Layouts,
    margins: Mapping[str, float | None],
) -> None:
    """The image of the one scene in `layout`, what stands on it and the room [m] a user wants around it."""
    recording.log(f"{entity}/image", rr.Image(image))
    items = footprints(layout)
    recording.log(
        f"{entity}/items",
        rr.LineStrips2D(
            [on_table(outline) for _, outline in items],
            labels=[symbol for symbol, _ in items],
            colors=ITEM,
            radii=0.25,
        ),
    )
    room = [on_table(outline) for _, outline in kept_clear(layout, margins)]
    recording.log(f"{entity}/kept_clear", rr.LineStrips2D(room, colors=KEPT_CLEAR, radii=0.12))


def log_map(recording: rr.RecordingStream, entity: str, values: Array) -> None:
    """P(valid) or validity [y, x]. Kept as it is: the viewer shows 0 black, 1 white and the value at the pointer."""
    recording.log(f"{entity}/map", rr.Image(map_image(values).astype(np.float32)))


def log_boundary(recording: rr.RecordingStream, entity: str, truth: Bool[Array, "side side"]) -> None:
    """Where the truth changes, over a map."""
    recording.log(f"{entity}/boundary", rr.LineStrips2D(boundary(truth), colors=BOUNDARY, radii=0.15))
