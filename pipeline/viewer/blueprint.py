"""The layout of a recording in the viewer.

A run has one tab per new scene, first those with repairs and with most errors, then interventions, learning and
training scenes. The overview has one tab per user, with the table, the truth, and each variant's map and errors. Every
tab shows its text next to the views.
"""

from collections.abc import Sequence

import rerun.blueprint as rrb

from pipeline.viewer.contents import Repairs, Run, by_user
from pipeline.viewer.geometry import PITCH, TABLE_PIXELS
from pipeline.viewer.scene import SCENE_TITLES

MARGIN = 0.06  # border shown around an image, relative to its side, since repairs may leave it
BACKDROP = (24, 24, 28)  # dark, so that image edges and white titles are visible in a light theme
FIXED = ("/fixed/ends", "/fixed/titles", "/fixed/table_edge")
BORDER = 6.0  # border around a board, and three times as much above it for titles [pixels of the table]
OVERVIEW_COLUMNS = 4  # columns of maps and errors next to the truth: views stay wide enough for their titles


def layout_of(run: Run, timeline: str) -> rrb.Blueprint:
    """Return the blueprint of `run`'s recording, which plays `timeline`."""
    worst_first = sorted(run.repairs, key=lambda shown: (not shown.start, shown.agreement))
    tabs = [*map(_repairs, worst_first), _interventions(run), _learning(run)]
    if run.demonstrations:
        tabs.append(_beside_text("Training scenes", _board("Demonstrations", "/training/**"), "training"))
    return _blueprint(tabs, rrb.TimePanel(state="collapsed", timeline=timeline, fps=6.0, loop_mode="all"))


def layout_of_overview(runs: Sequence[Run], timeline: str) -> rrb.Blueprint:
    """Return the blueprint of the overview of `runs`, in which `timeline` steps through the scenes."""
    tabs = [_comparison(user, of_user) for user, of_user in by_user(runs).items()]
    return _blueprint(tabs, rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused", fps=0.5))


def _blueprint(tabs: Sequence[rrb.Container], time: rrb.TimePanel) -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=0),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        time,
        auto_views=False,
    )


def _beside_text(name: str, shown: rrb.Container | rrb.View, text: str, *more: rrb.View) -> rrb.Container:
    """Return a tab with its contents, and next to them its text and `more` views."""
    what = rrb.TextDocumentView(origin=f"text/{text}", name="What you see")
    words = rrb.Vertical(what, *more) if more else what
    return rrb.Horizontal(shown, words, column_shares=[4, 1], name=name)


def _about() -> rrb.View:
    return rrb.TextDocumentView(origin="about", name="About this recording")


def _repairs(shown: Repairs) -> rrb.Container:
    entity = _scene(shown)
    views: list[rrb.View] = [_board("Repairs, on repair_step", f"/{entity}/**", *FIXED, *_without(entity, "learning"))]
    if shown.start:
        views += [
            _series(f"{entity}/p_valid", "Model's p(valid): above 0.5 accepted", "/fixed/even_odds"),
            _series(f"{entity}/slack", "True distance beyond the margin [cm]: above 0 valid"),
        ]
    name = f"New scene {shown.scene}: {1 - shown.agreement:.0%} of the map wrong"
    return _beside_text(name, rrb.Vertical(*views, row_shares=[5, 2, 2][: len(views)]), "repairs", _about())


def _interventions(run: Run) -> rrb.Container:
    scene = _scene(run.repairs[0])
    before = [f"/{scene}/table/**", f"/{scene}/latent/**", *_without(scene, "repair", "learning")]
    board = _board("Before, after, effect, on intervention", *before, "/interventions/**", *FIXED, rows=3)
    effects = rrb.TextDocumentView(origin="interventions/effects", name="Effects")
    return _beside_text("Interventions", board, "interventions", effects)


def _learning(run: Run) -> rrb.Container:
    scene = _scene(run.repairs[0])
    shown = [f"/{scene}/table/**", f"/{scene}/latent/truth/**", *_without(scene, "repair"), *FIXED]
    shown += [f"/{scene}/latent/{x}" for x in ("predicted/boundary", "predicted/learning/**", "difference/learning/**")]
    views = (
        _board("Maps, on demonstrations or train_step", *shown),
        _series("losses", "Losses, on train_step"),
    )
    return _beside_text("Learning", rrb.Vertical(*views, row_shares=[2, 1]), "learning")


def _scene(shown: Repairs) -> str:
    return f"new_items/scene_{shown.scene:03d}"


def _without(scene: str, *parts: str) -> list[str]:
    """Return a filter that excludes `parts` of a new scene's panels."""
    panels = ("table", "latent/predicted", "latent/truth", "latent/difference")
    return [f"- /{scene}/{panel}/{part}/**" for part in parts for panel in panels]


def _comparison(user: str, runs: Sequence[Run]) -> rrb.Container:
    """Return one user's tab: the table and the truth, then each variant's map and errors."""
    side = len(runs[0].repairs[0].truth)
    table = _spatial(f"{user}/table", "Table", TABLE_PIXELS, "/fixed/ends")
    truth = _spatial(f"{user}/truth", "Truth", side, "/fixed/table_edge")
    over = "/fixed/table_edge", f"/{user}/truth/boundary"
    views = [
        _spatial(f"{user}/{entity}/{run.variant}", f"{run.variant}: {title}", side, *over)
        for run in runs
        for entity, title in (("predicted", "p(valid)"), ("errors", "errors"))
    ]
    columns = min(OVERVIEW_COLUMNS, len(views))
    shown = rrb.Horizontal(
        rrb.Vertical(table, truth), rrb.Grid(*views, grid_columns=columns), column_shares=[1, columns]
    )
    return _beside_text(user, shown, "overview", _about())


def _spatial(origin: str, name: str, size: int, *over: str) -> rrb.Spatial2DView:
    shown = (-MARGIN * size, (1 + MARGIN) * size)
    return rrb.Spatial2DView(
        origin=origin,
        contents=["$origin/**", *over],
        name=name,
        background=BACKDROP,
        visual_bounds=rrb.VisualBounds2D(x_range=shown, y_range=shown),
    )


def _board(name: str, *contents: str, rows: int | None = None) -> rrb.Spatial2DView:
    """Return a view of panels with titles; Rerun fits it to the contents unless `rows` are given."""
    bounds = None
    if rows is not None:
        width, height = (PITCH * count - (PITCH - TABLE_PIXELS) for count in (len(SCENE_TITLES), rows))
        bounds = rrb.VisualBounds2D(x_range=(-BORDER, width + BORDER), y_range=(-3 * BORDER, height + BORDER))
    return rrb.Spatial2DView(origin="/", contents=list(contents), name=name, background=BACKDROP, visual_bounds=bounds)


def _series(origin: str, name: str, *more: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, contents=["$origin/**", *more], name=name)
