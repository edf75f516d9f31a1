"""The layout of recordings in the viewer: tabs with text next to their views; the last tab holds the parameters."""

import uuid
from collections.abc import Sequence

import rerun.blueprint as rrb

from pipeline.viewer.geometry import PITCH, TABLE_PIXELS
from pipeline.viewer.scene import APPLICATION

BACKDROP = (24, 24, 28)  # dark, so that image edges and white titles are visible in a light theme
AROUND = 4.0  # border around a board, and four times as much above it for titles [pixels of the table]


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
    words = rrb.Vertical(what, *more) if more else what
    return rrb.Horizontal(shown, words, column_shares=[3, 1], name=name)


def board(shape: tuple[int, int], *contents: str) -> rrb.Spatial2DView:
    """Return a view of panels in `shape` (rows, columns) with titles."""
    height, width = (PITCH * count - (PITCH - TABLE_PIXELS) for count in shape)
    bounds = rrb.VisualBounds2D(x_range=(-AROUND, width + AROUND), y_range=(-4 * AROUND, height + 2 * AROUND))
    return rrb.Spatial2DView(
        origin="/", contents=list(contents), background=BACKDROP, visual_bounds=bounds, titlebar=False
    )
