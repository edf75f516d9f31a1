"""Shared parts of recordings: the file, a scene on the table, a map over z_theta, panels with titles.

Entities are logged at the current time, or for all times if none is set. A run's tables and maps are arranged on
boards: one view with panels of the table's size in rows and columns.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array

from pipeline.viewer.geometry import (
    TABLE_PIXELS,
    boundary,
    corner,
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

# Colours of Okabe and Ito, distinguishable with colour blindness.
VALID, INVALID = (0, 158, 255), (230, 97, 0)  # RGB
ITEM, KEPT_CLEAR = (255, 255, 255), (255, 255, 255, 110)  # RGB, RGBA
BOUNDARY, TABLE_EDGE = (213, 0, 120), (0, 150, 170)  # RGB
ADDED = (240, 228, 66)  # an added item
SAME = (70, 70, 74)  # cells on which two maps agree

# Classes of a difference map's cells: from blue over grey to orange, named by their value.
DIFFERENCES = tuple(
    (
        i,
        f"{(i - 100) / 100:+.2f}",
        tuple(round(np.interp(i, [0, 100, 200], ends)) for ends in zip(VALID, SAME, INVALID, strict=True)),
    )
    for i in range(201)
)

OVERLAY = -5.0  # draw order: above images (-10), below everything else
HALF = np.float16  # three digits in half the bytes, for maps, of which a run has many

# The time lines of a run's recording, each with the time at which it shows the entities of the other time lines.
TIMELINES = {"repair_step": 0, "intervention": 0, "demonstrations": 1, "train_step": 0}

Panel = tuple[int, int]  # row and column on a board
TITLE = np.array([TABLE_PIXELS / 2, -7.0])  # offset of a title from its panel's corner
SCENE_MAPS = {"predicted": (0, 1), "truth": (0, 2), "difference": (0, 3)}  # panels (row, column)
SCENE_TITLES = {(0, 0): "Table", (0, 1): "Model's p(valid)", (0, 2): "Truth", (0, 3): "Difference: model - truth"}


@contextmanager
def recording_at(path: Path, name: str, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """Open a recording called `name` that is written to `path` with its blueprint, and close it afterwards."""
    recording = rr.RecordingStream(APPLICATION, recording_id=name, send_properties=False)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    recording.save(path, default_blueprint=blueprint)
    recording.send_recording_name(name)
    yield recording
    recording.flush()
    recording.disconnect()


def log_static(recording: rr.RecordingStream, entity: str, value: rr.AsComponents) -> None:
    """Log for all times."""
    recording.log(entity, value, static=True)


def log_texts(recording: rr.RecordingStream, about: str, texts: Mapping[str, str]) -> None:
    """Log the sources of the recording, and the text of each tab."""
    log_static(recording, "about", markdown(about))
    for name, text in texts.items():
        log_static(recording, f"text/{name}", markdown(text))


def markdown(text: str) -> rr.TextDocument:
    """Return a text as a markdown document for Rerun."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def set_time(recording: rr.RecordingStream, timeline: str, step: int) -> None:
    """Log from now on at a step of one time line; other time lines show the last step."""
    for other, first in TIMELINES.items():
        recording.set_time(other, sequence=first)
    recording.set_time(timeline, sequence=step)


def log_ends(recording: rr.RecordingStream) -> None:
    """Log both ends of all paths, on the table."""
    ends = on_table(np.stack([P_INIT, P_F]))
    log_static(recording, "fixed/ends", rr.Points2D(ends, labels=["start", "goal"], colors=ITEM, radii=1.2))


def log_table_edge(recording: rr.RecordingStream, entity: str, edges: Float[Array, "map 5 2"], radius: float) -> None:
    """Log the table's edge in maps."""
    log_static(recording, f"{entity}/table_edge", rr.LineStrips2D(edges, colors=TABLE_EDGE, radii=radius))


def table_edge(side: int) -> Float[Array, "5 2"]:
    """Return the table's edge in a map of `side` cells per side."""
    return on_map(np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float), side)


def panel(place: Panel, side: int) -> rr.Transform3D:
    """Return the transform that puts an entity of `side` units per side at its panel on a board."""
    x, y = corner(*place)
    return rr.Transform3D(translation=[x, y, 0], scale=TABLE_PIXELS / side)


def log_titles(
    recording: rr.RecordingStream, entity: str, titles: Mapping[Panel, str], maps: Sequence[Panel] = ()
) -> None:
    """Log a title over each panel, and the table's edge in panels with maps."""
    above = [corner(*place) + TITLE for place in titles]
    labels = rr.Points2D(above, labels=list(titles.values()), colors=ITEM, radii=0)
    log_static(recording, f"{entity}/titles", labels)
    if maps:
        edges = np.stack([table_edge(TABLE_PIXELS) + corner(*place) for place in maps])
        log_table_edge(recording, entity, edges, 0.3)


def log_table(
    recording: rr.RecordingStream,
    entity: str,
    image: UInt8[Array, "100 100 3"],
    layout: Layouts,
    margins: Mapping[str, float | None],
) -> None:
    """Log the image of the one scene in `layout`, its items and the margins [m] around them."""
    recording.log(f"{entity}/image", png(image))
    items = footprints(layout)
    outlines = [on_table(outline) for _, outline in items]
    names = [symbol for symbol, _ in items]
    recording.log(f"{entity}/items", rr.LineStrips2D(outlines, labels=names, colors=ITEM, radii=0.25))
    clear = [on_table(outline) for _, outline in kept_clear(layout, margins)]
    recording.log(f"{entity}/kept_clear", rr.LineStrips2D(clear, colors=KEPT_CLEAR, radii=0.12))


def png(image: UInt8[Array, "100 100 channel"]) -> rr.EncodedImage:
    """Return an RGB or RGBA image as a PNG; an RGBA image lies above the others."""
    overlay = image.shape[-1] == 4
    bgr = cv2.cvtColor(image, cv2.COLOR_RGBA2BGRA if overlay else cv2.COLOR_RGB2BGR)
    written, file = cv2.imencode(".png", bgr, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    assert written
    order = OVERLAY if overlay else None
    return rr.EncodedImage(contents=file.tobytes(), media_type="image/png", opacity=1.0, draw_order=order)


def log_map(
    recording: rr.RecordingStream,
    entity: str,
    values: Array,
    *place: rr.AsComponents,
    precision: type[np.floating] = np.float32,
) -> None:
    """Log P(valid) or validity [y, x]: 0 black, 1 white."""
    recording.log(f"{entity}/map", rr.Image(map_image(values).astype(precision)), *place)


def log_difference(
    recording: rr.RecordingStream, entity: str, values: Float[Array, "side side"], *place: rr.AsComponents
) -> None:
    """Log the difference of two maps [y, x], rounded to a hundredth, in the classes of `DIFFERENCES`."""
    recording.log(f"{entity}/map", rr.SegmentationImage(map_image(percent(values)), opacity=1.0), *place)


def log_boundary(recording: rr.RecordingStream, entity: str, truth: Bool[Array, "side side"]) -> None:
    """Log the boundary of the true valid region, over a map."""
    recording.log(f"{entity}/boundary", rr.LineStrips2D(boundary(truth), colors=BOUNDARY, radii=0.15))
