"""How the viewer lays a recording out.

A run: a tab a new scene, the one in which the model errs most first, with its table and its maps above p(valid) and
the true slack of its repairs; then tabs of what-ifs, of how the model came about and of its demonstrations. The
overview: a tab a user, the table above the truth, and beside them each variant's latent map above its errors.
"""

from collections.abc import Sequence

import rerun.blueprint as rrb

from pipeline.viewer.contents import Repairs, Run, by_user
from pipeline.viewer.geometry import TABLE_PIXELS

MARGIN = 0.06  # shown around an image, of its side: repairs may leave it
BACKDROP = (24, 24, 28)  # so that the image's edge is seen
FIXED = ("/fixed/ends", "/fixed/titles", "/fixed/table_edge")


def layout_of(run: Run, timeline: str) -> rrb.Blueprint:
    """The blueprint saved inside `run`'s recording; `timeline` is the time line it plays."""
    worst_first = sorted(run.repairs, key=lambda shown: shown.agreement)
    tabs: list[rrb.Container | rrb.View] = [*map(_repairs, worst_first), _interventions(run)]
    if run.counterfactuals:
        tabs.append(_counterfactuals())
    tabs.append(_learning(run))
    if run.demonstrations:
        tabs.append(_board("Training scenes", "/training/**"))
    return _beside_page(tabs, rrb.TimePanel(state="collapsed", timeline=timeline, fps=6.0, loop_mode="all"))


def layout_of_overview(runs: Sequence[Run], timeline: str) -> rrb.Blueprint:
    """The blueprint saved inside the overview of `runs`; `timeline` goes from scene to scene."""
    tabs = [_comparison(user, of_user) for user, of_user in by_user(runs).items()]
    return _beside_page(tabs, rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused", fps=0.5))


def _beside_page(tabs: Sequence[rrb.Container | rrb.View], time: rrb.TimePanel) -> rrb.Blueprint:
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Tabs(*tabs, active_tab=0),
            rrb.TextDocumentView(origin="readme", name="What you see"),
            column_shares=[4, 1],
        ),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        time,
        auto_views=False,
    )


def _repairs(shown: Repairs) -> rrb.Container:
    entity = _scene(shown)
    name = f"New scene {shown.scene}: {1 - shown.agreement:.0%} of the map wrong"
    views: list[rrb.View] = [_board("Repairs, on repair_step", f"/{entity}/**", *FIXED, *_without(entity, "learning"))]
    if shown.start:
        views += [
            _series(f"{entity}/p_valid", "Model's p(valid)", "/fixed/even_odds"),
            _series(f"{entity}/slack", "True slack [cm]: above 0 valid"),
        ]
    return rrb.Vertical(*views, row_shares=[5, 2, 2][: len(views)], name=name)


def _interventions(run: Run) -> rrb.Container:
    scene = _scene(run.repairs[0])
    before = [f"/{scene}/table/**", f"/{scene}/latent/**", *_without(scene, "repair", "learning")]
    board = _board("Before, after, effect, on intervention", *before, "/interventions/**", *FIXED)
    words = rrb.TextDocumentView(origin="interventions/words", name="This intervention")
    return rrb.Horizontal(board, words, column_shares=[5, 2], name="Interventions")


def _counterfactuals() -> rrb.Container:
    name = "What if this item were not there, on counterfactual"
    board = _board(name, "/counterfactuals/table/**", "/fixed/ends")
    words = rrb.TextDocumentView(origin="counterfactuals/words", name="This question")
    return rrb.Horizontal(board, words, column_shares=[2, 1], name="Counterfactuals")


def _learning(run: Run) -> rrb.Container:
    scene = _scene(run.repairs[0])
    shown = [f"/{scene}/table/**", f"/{scene}/latent/truth/**", *_without(scene, "repair"), *FIXED]
    shown += [f"/{scene}/latent/{x}" for x in ("predicted/boundary", "predicted/learning/**", "difference/learning/**")]
    return rrb.Vertical(
        _board("By the demonstrations a scene, on demonstrations; along the training, on train_step", *shown),
        _series("losses", "Losses, on train_step"),
        row_shares=[2, 1],
        name="Learning",
    )


def _scene(shown: Repairs) -> str:
    return f"new_items/scene_{shown.scene:03d}"


def _without(scene: str, *parts: str) -> list[str]:
    """A filter that leaves out what is drawn over a new scene's panels."""
    panels = ("table", "latent/predicted", "latent/truth", "latent/difference")
    return [f"- /{scene}/{panel}/{part}/**" for part in parts for panel in panels]


def _comparison(user: str, runs: Sequence[Run]) -> rrb.Container:
    """One user's scenes: the table above the truth, then a column a variant."""
    side = len(runs[0].repairs[0].truth)
    table = _spatial(f"{user}/table", "Table", TABLE_PIXELS, "/fixed/ends")
    truth = _spatial(f"{user}/truth", "Truth", side, "/fixed/table_edge")
    columns = [rrb.Vertical(table, truth)]
    over = "/fixed/table_edge", f"/{user}/truth/boundary"
    for run in runs:
        predicted = _spatial(f"{user}/predicted/{run.variant}", f"{run.variant}: p(valid)", side, *over)
        errors = _spatial(f"{user}/errors/{run.variant}", f"{run.variant}: errors", side, *over)
        columns.append(rrb.Vertical(predicted, errors))
    return rrb.Horizontal(*columns, name=user)


def _spatial(origin: str, name: str, size: int, *over: str) -> rrb.Spatial2DView:
    shown = (-MARGIN * size, (1 + MARGIN) * size)
    return rrb.Spatial2DView(
        origin=origin,
        contents=["$origin/**", *over],
        name=name,
        background=BACKDROP,
        visual_bounds=rrb.VisualBounds2D(x_range=shown, y_range=shown),
    )


def _board(name: str, *contents: str) -> rrb.Spatial2DView:
    """Panels with their titles, all in view; every setting more would cost a recording three kilobytes."""
    return rrb.Spatial2DView(origin="/", contents=list(contents), name=name)


def _series(origin: str, name: str, *over: str) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(origin=origin, contents=["$origin/**", *over], name=name)
