"""What every recording is made of: the file itself, a scene on the table, a map over z_theta.

A scene and its maps are logged at the time that is set, or for all times if none is.
"""

import io
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array
from PIL import Image

from pipeline.viewer.geometry import (
    boundary,
    footprints,
    kept_clear,
    map_image,
    on_map,
    on_table,
    percent,
)
from pipeline.world.bezier import P_F, P_INIT
from pipeline.world.layout import Layouts

APPLICATION = "causal-specifications"

# Okabe and Ito's colours, which people with any colour vision tell apart.
VALID, INVALID = (0, 158, 255), (230, 97, 0)
ITEM, KEPT_CLEAR = (255, 255, 255), (255, 255, 255, 110)
BOUNDARY, TABLE_EDGE = (213, 0, 120), (0, 150, 170)
CHOSEN = (240, 228, 66)  # an item added or taken away
SAME = (70, 70, 74)  # where two maps agree

# The class of a cell of a difference map is `percent` of it: from blue over grey to orange, named by its value.
DIFFERENCES = tuple(
    (
        i,
        f"{(i - 100) / 100:+.2f}",
        tuple(round(np.interp(i, [0, 100, 200], ends)) for ends in zip(VALID, SAME, INVALID, strict=True)),
    )
    for i in range(201)
)

OVERLAY = -5.0  # draw order: over images (-10), under everything else
HALF = np.float16  # three digits, in half the bytes: for maps of which a run holds many

# The time lines of a run's recording, with the time at which each shows what lies on another one.
TIMELINES = {"repair_step": 0, "intervention": 0, "counterfactual": 0, "demonstrations": 1, "train_step": 0}


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
    recording.log("readme", words(markdown), static=True)


def words(markdown: str) -> rr.TextDocument:
    """A page."""
    return rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN)


def set_time(recording: rr.RecordingStream, timeline: str, step: int) -> None:
    """What is logged from now on belongs to a step of one time line; on every other one the last of it is seen."""
    for other, first in TIMELINES.items():
        recording.set_time(other, sequence=first)
    recording.set_time(timeline, sequence=step)


def log_ends(recording: rr.RecordingStream) -> None:
    """Both ends of every path, on the table."""
    ends = on_table(np.stack([P_INIT, P_F]))
    recording.log("fixed/ends", rr.Points2D(ends, labels=["start", "goal"], colors=ITEM, radii=1.2), static=True)


def log_table_edge(recording: rr.RecordingStream, entity: str, edges: Float[Array, "map 5 2"], radius: float) -> None:
    """Where the table lies in maps."""
    recording.log(f"{entity}/table_edge", rr.LineStrips2D(edges, colors=TABLE_EDGE, radii=radius), static=True)


def table_edge(side: int) -> Float[Array, "5 2"]:
    """The table's edge in a map of `side` cells a side."""
    return on_map(np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float), side)


def log_table(
    recording: rr.RecordingStream,
    entity: str,
    image: UInt8[Array, "100 100 3"],
    layout: Layouts,
    margins: Mapping[str, float | None],
) -> None:
    """The image of the one scene in `layout`, what stands on it and the room [m] a user wants around it."""
    recording.log(f"{entity}/image", picture(image))
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


def picture(image: UInt8[Array, "100 100 channel"]) -> rr.EncodedImage:
    """An image as a PNG, half the bytes and nothing lost; with a fourth channel, it lies over the other ones."""
    file = io.BytesIO()
    Image.fromarray(image).save(file, "PNG")
    order = OVERLAY if image.shape[-1] == 4 else None
    return rr.EncodedImage(contents=file.getvalue(), media_type="image/png", opacity=1.0, draw_order=order)


def log_map(
    recording: rr.RecordingStream,
    entity: str,
    values: Array,
    *place: rr.AsComponents,
    precision: type[np.floating] = np.float32,
) -> None:
    """P(valid) or validity [y, x]: the viewer shows 0 black, 1 white and the value at the pointer."""
    recording.log(f"{entity}/map", rr.Image(map_image(values).astype(precision)), *place)


def log_difference(
    recording: rr.RecordingStream, entity: str, values: Float[Array, "side side"], *place: rr.AsComponents
) -> None:
    """The difference of two maps [y, x] to a hundredth, coloured and named by the classes of `DIFFERENCES`."""
    recording.log(f"{entity}/map", rr.SegmentationImage(map_image(percent(values)), opacity=1.0), *place)


def log_boundary(recording: rr.RecordingStream, entity: str, truth: Bool[Array, "side side"]) -> None:
    """Where the truth changes, over a map."""
    recording.log(f"{entity}/boundary", rr.LineStrips2D(boundary(truth), colors=BOUNDARY, radii=0.15))
