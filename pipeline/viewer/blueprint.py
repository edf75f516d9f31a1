"""The layout of a recording in the viewer.

A run has one tab per new scene, first those with repairs and with most errors, then interventions, learning and
training scenes. The overview has one tab per user. Every tab shows its text next to the views; the last tab holds the
parameters and the data version.
"""

import uuid
from collections.abc import Sequence

import rerun.blueprint as rrb

from pipeline.viewer.contents import Repairs, Run, grouped
from pipeline.viewer.geometry import PITCH, TABLE_PIXELS
from pipeline.viewer.scene import APPLICATION, scene_name

BACKDROP = (24, 24, 28)  # dark, so that image edges and white titles are visible in a light theme
FIXED = "/fixed/titles", "/fixed/table_edges"
AROUND = 4.0  # border around a board, and four times as much above it for titles [pixels of the table]


def layout_of(run: Run, timeline: str) -> rrb.Blueprint:
    """Return the blueprint of `run`'s recording, which plays `timeline`."""
    worst_first = sorted(run.repairs, key=lambda shown: (not shown.start, shown.agreement))
    first = scene_name(run.repairs[0].scene)
    tabs = [*map(_repairs, worst_first), _interventions(first), _learning(first)]
    if run.demonstrations:
        board = _board((1, len(run.demonstrations)), "/training/**")
        tabs.append(beside_text("Training scenes", board, "training"))
    return tabbed(run.name, tabs, rrb.TimePanel(state="collapsed", timeline=timeline, fps=6.0, loop_mode="all"))


def layout_of_overview(runs: Sequence[Run], timeline: str, shape: tuple[int, int]) -> rrb.Blueprint:
    """Return the blueprint of the overview: boards of `shape` (rows, columns), and `timeline` for the scenes."""
    tabs = [
        beside_text(f"{user} user", _board(shape, f"/{user}/**", "/fixed/table_edges"), "overview")
        for user in grouped(runs, "user")
    ]
    time = rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused", fps=0.5)
    return tabbed("overview", tabs, time)


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


def _repairs(shown: Repairs) -> rrb.Container:
    scene = scene_name(shown.scene)
    views: list[rrb.Container | rrb.View] = [
        _board((1, 3), *(f"/{panel}/{scene}/**" for panel in ("table", "predicted", "outcomes")), *FIXED)
    ]
    if shown.start:
        accepted = _series(f"p_valid/{scene}", "Model's P(valid): accepted above 0.5")
        slack = _series(f"slack/{scene}", "True distance beyond the margin [cm]: valid above 0")
        views.append(rrb.Horizontal(accepted, slack))
    name = f"New scene {shown.scene}: {1 - shown.agreement:.0%} wrong"
    return beside_text(name, rrb.Vertical(*views, row_shares=[4, 3][: len(views)]), "repairs")


def _table(scene: str) -> list[str]:
    """Return the contents of a scene's table without its repairs."""
    return [f"/table/{scene}/{part}" for part in ("image", "outlines", "names")]


def _interventions(scene: str) -> rrb.Container:
    board = _board((2, 3), *_table(scene), "/interventions/**")
    effects = rrb.TextDocumentView(origin="interventions/effects", name="Effects")
    return beside_text("Interventions", board, "interventions", effects)


def _learning(scene: str) -> rrb.Container:
    maps = "/predicted/learning/**", "/outcomes/learning/**"
    views = _board((1, 3), *_table(scene), *maps, *FIXED), _series("losses", "Losses, on train_step")
    return beside_text("Learning", rrb.Vertical(*views, row_shares=[4, 3]), "learning")


def _board(shape: tuple[int, int], *contents: str) -> rrb.Spatial2DView:
    """Return a view of panels in `shape` (rows, columns) with titles."""
    height, width = (PITCH * count - (PITCH - TABLE_PIXELS) for count in shape)
    bounds = rrb.VisualBounds2D(x_range=(-AROUND, width + AROUND), y_range=(-4 * AROUND, height + 2 * AROUND))
    return rrb.Spatial2DView(
        origin="/", contents=list(contents), background=BACKDROP, visual_bounds=bounds, titlebar=False
    )


def _series(origin: str, name: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, name=name)
