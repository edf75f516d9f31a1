"""Shared parts of recordings: the file and its tabs, a scene on the table, a map over z_theta, panels with titles.

Entities are logged at the current time, or for all times if none is set. Tables and maps are arranged on boards: one
view with panels of the table's size in rows and columns. A map is an image of classes, in the pages' colours.

On the table a unit is a pixel of the image (1 cm); on a map over z_theta a unit is a cell. Both have their origin in
the far left corner, with y towards the viewer, as in images. On a board a unit is a pixel.
"""

import os
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Bool, Float, UInt8
from numpy import ndarray as Array

from pipeline import legend
from pipeline.world.bezier import P_F, P_INIT, Z_HIGH, Z_LOW
from pipeline.world.layout import SYMBOLS, Layouts
from pipeline.world.rules import Margins

APPLICATION = "causal-specifications"
JPEG_QUALITY = 90
TABLE_PIXELS = 100  # side of a scene's image [px]; the table is 1 m wide
PITCH = 112.0  # distance between panels of a board [px]
ARC_POINTS = 16  # points on each round end of a footprint
NO_MARGINS: Margins = dict.fromkeys(SYMBOLS, 0.0)

VALID, INVALID, START = (tuple(bytes.fromhex(x[1:])) for x in (legend.VALID, legend.INVALID, legend.START))  # RGB
ITEM, KEPT_CLEAR = (255, 255, 255), (255, 255, 255, 110)  # RGB, RGBA; titles are white, too
BOUNDARY, TABLE_EDGE = (213, 0, 120), (143, 143, 143)  # RGB
BACKDROP = (24, 24, 28)  # dark, so that image edges and white titles are visible in a light theme
LIGHT, DARK = (222, 222, 222), (62, 62, 68)  # valid and invalid where model and truth agree; no effect is dark, too

# First class of P(valid) in hundredths, of `Shown.outcomes`, and of effects from -1 to 1 in fiftieths.
P_VALID, OUTCOME, EFFECT = 0, 101, 105
OUTCOMES = ("invalid", DARK), ("valid", LIGHT), ("invalid, called valid", INVALID), ("valid, called invalid", VALID)

Panel = tuple[int, int]  # row and column on a board
AROUND = 4.0  # border around a board, and four times as much above it for titles [pixels of the table]
TITLE = np.array([TABLE_PIXELS / 2, -7.0])  # offset of a title from its panel's corner


def on_table(points: Float[Array, "*b 2"]) -> Float[Array, "*b 2"]:
    """Return points [m] in pixels of the scene's image."""
    return np.stack([points[..., 0], 1.0 - points[..., 1]], axis=-1) * TABLE_PIXELS


def on_map(z_theta: Float[Array, "*b 2"], side: int) -> Float[Array, "*b 2"]:
    """Return control points [m] in cells of a map of `side` x `side`."""
    cell = (Z_HIGH - Z_LOW) / side
    return np.stack([z_theta[..., 0] - Z_LOW, Z_HIGH - z_theta[..., 1]], axis=-1) / cell


def corner(row: int, column: int) -> Float[Array, "2"]:
    """Return the far left corner of a board's panel."""
    return PITCH * np.array([column, row], dtype=float)


def map_image(values: Array) -> Array:
    """Return values [y, x] on `bezier.lattice` as an image, with the largest y in row 0."""
    return np.ascontiguousarray(values[::-1])


def footprints(layout: Layouts, margins: Margins = NO_MARGINS) -> list[tuple[str, Float[Array, "point 2"]]]:
    """Return the symbol and the closed outline [m], enlarged by its margin, of the one scene's items with a margin."""
    half_turn = np.linspace(0.5 * np.pi, 1.5 * np.pi, ARC_POINTS)
    outlines = []
    for slot in np.flatnonzero(layout.present[0]):
        symbol = SYMBOLS[layout.symbol[0, slot]]
        margin = margins[symbol]
        if margin is None:
            continue
        around = np.concatenate([half_turn, half_turn + np.pi, half_turn[:1]]) + layout.angle[0, slot]
        centres = np.repeat(layout.ends[0, slot], ARC_POINTS, axis=0)  # (2 * ARC_POINTS, 2)
        centres = np.concatenate([centres, centres[:1]])
        ring = np.stack([np.cos(around), np.sin(around)], axis=-1)
        outlines.append((symbol, centres + (layout.radius[0, slot] + margin) * ring))
    return outlines


def boundary(truth: Bool[Array, "side side"]) -> Float[Array, "edge 2 2"]:
    """Return the edges between valid and invalid cells of a map [y, x], in the coordinates of `on_map`."""
    image = map_image(truth)
    row, column = np.nonzero(image[:, 1:] != image[:, :-1])
    upright = np.stack([np.stack([column + 1, row], -1), np.stack([column + 1, row + 1], -1)], axis=1)
    row, column = np.nonzero(image[1:] != image[:-1])
    level = np.stack([np.stack([column, row + 1], -1), np.stack([column + 1, row + 1], -1)], axis=1)
    return np.concatenate([upright, level]).astype(float)


def tabbed(name: str, tabs: Sequence[rrb.Container], time: rrb.TimePanel) -> rrb.Blueprint:
    """Return the blueprint of the recording `name`: its tabs, and one with the parameters."""
    about = rrb.TextDocumentView(origin="about", name="Parameters and data")
    root = rrb.Tabs(*tabs, about, active_tab=0)
    parts: list[rrb.Container | rrb.View] = [root]
    for number, part in enumerate(parts):  # grows as it goes; ids are fixed, so that `digest` is the same each time
        part.id = uuid.uuid5(uuid.NAMESPACE_OID, f"{APPLICATION}/{name}/{number}")
        parts += part.contents if isinstance(part, rrb.Container) else []
    hidden = rrb.BlueprintPanel(state="hidden"), rrb.SelectionPanel(state="hidden")
    return rrb.Blueprint(root, *hidden, time, auto_views=False)


def beside_text(name: str, shown: rrb.Container | rrb.View, text: str, *more: rrb.View) -> rrb.Container:
    """Return a tab with its contents, and next to them its text and `more` views."""
    what = rrb.TextDocumentView(origin=f"text/{text}", name="What you see")
    return rrb.Horizontal(shown, rrb.Vertical(what, *more) if more else what, column_shares=[3, 1], name=name)


def board(shape: tuple[int, int], *contents: str) -> rrb.Spatial2DView:
    """Return a view of panels in `shape` (rows, columns) with titles."""
    height, width = (PITCH * count - (PITCH - TABLE_PIXELS) for count in shape)
    bounds = rrb.VisualBounds2D(x_range=(-AROUND, width + AROUND), y_range=(-4 * AROUND, height + 2 * AROUND))
    return rrb.Spatial2DView(contents=list(contents), background=BACKDROP, visual_bounds=bounds, titlebar=False)


@cache
def classes() -> rr.AnnotationContext:
    """Return number, label and colour of every class in a map."""
    p = matplotlib.colormaps[legend.MAP](np.linspace(0, 1, 101), bytes=True)[:, :3].tolist()
    labelled = [(f"{i / 100:.2f}", tuple(colour)) for i, colour in enumerate(p)] + list(OUTCOMES)
    ends = list(zip(INVALID, DARK, VALID, strict=True))  # from becoming invalid to becoming valid
    for i in range(101):
        labelled.append((f"{i / 50 - 1:+.2f}", tuple(round(np.interp(i, [0, 50, 100], channel)) for channel in ends)))
    return rr.AnnotationContext([(number, *entry) for number, entry in enumerate(labelled)])


@contextmanager
def recording_at(path: Path, name: str, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """Open a recording called `name` that is written to `path` with its blueprint, and close it afterwards.

    Rerun's variables in the environment, such as RERUN=off, would turn it off, or send it elsewhere: they are removed.
    """
    for variable in [variable for variable in os.environ if variable.startswith(("RERUN", "_RERUN"))]:
        del os.environ[variable]
    recording = rr.RecordingStream(APPLICATION, recording_id=name, send_properties=False)
    recording.set_log_time_enabled(False)
    recording.set_log_tick_enabled(False)
    recording.save(path, default_blueprint=blueprint)
    recording.send_recording_name(name)
    recording.log("/", classes(), static=True)
    yield recording
    recording.flush()
    recording.disconnect()


def log_texts(recording: rr.RecordingStream, about: str, texts: Mapping[str, str]) -> None:
    """Log the sources of the recording, and the text of each tab."""
    recording.log("about", markdown(about), static=True)
    for name, text in texts.items():
        recording.log(f"text/{name}", markdown(text), static=True)


def markdown(text: str) -> rr.TextDocument:
    """Return a text as a markdown document for Rerun."""
    return rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)


def panel(place: Panel, side: int) -> rr.Transform3D:
    """Return the transform that puts an entity of `side` units per side at its panel on a board."""
    x, y = corner(*place)
    return rr.Transform3D(translation=[x, y, 0], scale=TABLE_PIXELS / side)


def log_titles(recording: rr.RecordingStream, entity: str, titles: Mapping[Panel, str]) -> None:
    """Log a title over each panel."""
    above = [corner(*place) + TITLE for place in titles]
    recording.log(f"{entity}/titles", rr.Points2D(above, labels=list(titles.values()), colors=ITEM, radii=0))


def log_table_edges(recording: rr.RecordingStream, entity: str, maps: Iterable[Panel]) -> None:
    """Log the table's edge in panels with maps."""
    edge = on_map(np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float), TABLE_PIXELS)
    edges = np.stack([edge + corner(*place) for place in maps])
    recording.log(f"{entity}/table_edges", rr.LineStrips2D(edges, colors=TABLE_EDGE, radii=0.3), static=True)


def log_table(
    recording: rr.RecordingStream, entity: str, image: UInt8[Array, "100 100 3"], layout: Layouts, margins: Margins,
    **when: bool,
) -> None:  # fmt: skip
    """Log the image of the one scene in `layout`, its items, the margins [m] around them, start and goal."""
    recording.log(f"{entity}/image", jpeg(image), **when)
    items = [(symbol, on_table(outline)) for symbol, outline in footprints(layout)]
    clear = [on_table(outline) for _, outline in footprints(layout, margins)]
    colours, radii = len(items) * [ITEM] + len(clear) * [KEPT_CLEAR], len(items) * [0.25] + len(clear) * [0.12]
    outlines = [*(outline for _, outline in items), *clear]
    recording.log(f"{entity}/outlines", rr.LineStrips2D(outlines, colors=colours, radii=radii), **when)
    below = [[outline[:, 0].mean(), outline[:, 1].max()] for _, outline in items]
    marks = [*on_table(np.stack([P_INIT, P_F])).tolist(), *below]
    labels, sizes = ["start", "goal", *(symbol for symbol, _ in items)], [1.2, 1.2, *len(items) * [0.0]]
    recording.log(f"{entity}/names", rr.Points2D(marks, labels=labels, colors=ITEM, radii=sizes), **when)


def jpeg(image: UInt8[Array, "100 100 3"]) -> rr.EncodedImage:
    """Return an RGB image as a JPEG without subsampled colours: a sixth of a PNG's bytes."""
    full = [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    written, file = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY, *full])
    assert written
    return rr.EncodedImage(contents=file.tobytes(), media_type="image/jpeg")


def p_classes(values: Array) -> UInt8[Array, "*map"]:
    """Return the classes of P(valid) or of validity."""
    return (P_VALID + np.round(100 * values.astype(float))).astype(np.uint8)


def log_map(recording: rr.RecordingStream, entity: str, values: UInt8[Array, "y x"], *place: rr.AsComponents) -> None:
    """Log a map of classes."""
    recording.log(f"{entity}/map", rr.SegmentationImage(map_image(values), opacity=1.0), *place)
