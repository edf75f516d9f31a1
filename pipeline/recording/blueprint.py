"""How the viewer lays a recording out.

A run: a tab a scene, the table beside its latent maps, p(valid) below. The overview: a tab a user, the table above the
truth, and beside them each variant's latent map above its errors.
"""

from collections.abc import Sequence

import rerun.blueprint as rrb

from pipeline.recording.contents import Demonstrations, Repairs, Run, by_user
from pipeline.recording.geometry import TABLE_PIXELS

MARGIN = 0.06  # shown around an image, of its side: repairs may leave it
BACKDROP = (24, 24, 28)  # so that the image's edge is seen


def layout_of(run: Run, timeline: str) -> rrb.Blueprint:
    """The blueprint saved inside `run`'s recording; `timeline` is the time line it plays."""
    tabs: list[rrb.Container] = [_repairs(shown) for shown in run.repairs]
    if run.demonstrations:
        tabs.append(rrb.Grid(*map(_demonstrations, run.demonstrations), name="Demonstrations"))
    return _beside_page(tabs, rrb.TimePanel(state="collapsed", timeline=timeline, fps=6.0, loop_mode="all"))


def layout_of_overview(runs: Sequence[Run], timeline: str) -> rrb.Blueprint:
    """The blueprint saved inside the overview of `runs`; `timeline` goes from scene to scene."""
    tabs = [_comparison(user, of_user) for user, of_user in by_user(runs).items()]
    return _beside_page(tabs, rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused", fps=0.5))


def _beside_page(tabs: Sequence[rrb.Container], time: rrb.TimePanel) -> rrb.Blueprint:
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
    entity, side = f"new_items/scene_{shown.scene:03d}", len(shown.truth)
    name = f"New scene {shown.scene}"
    views = [
        _spatial(f"{entity}/table", "Table", TABLE_PIXELS, "/fixed/ends"),
        _spatial(f"{entity}/latent/predicted", "Latent map: model's p(valid)", side, "/fixed/table_edge"),
        _spatial(f"{entity}/latent/truth", "Latent map: truth", side, "/fixed/table_edge"),
    ]
    if not shown.start:
        return rrb.Horizontal(*views, name=name)
    series = rrb.TimeSeriesView(
        origin=f"{entity}/p_valid",
        name="Model's p(valid) over the repairs' steps",
        axis_y=rrb.ScalarAxis(range=(-0.02, 1.02)),
        plot_legend=rrb.PlotLegend(visible=True),
    )
    return rrb.Vertical(rrb.Horizontal(*views), series, row_shares=[3, 1], name=name)


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


def _demonstrations(shown: Demonstrations) -> rrb.Spatial2DView:
    entity = f"training/scene_{shown.scene:03d}"
    return _spatial(entity, f"Training scene {shown.scene}", TABLE_PIXELS, "/fixed/ends")


def _spatial(origin: str, name: str, size: int, *over: str) -> rrb.Spatial2DView:
    shown = (-MARGIN * size, (1 + MARGIN) * size)
    return rrb.Spatial2DView(
        origin=origin,
        contents=["$origin/**", *over],
        name=name,
        background=BACKDROP,
        visual_bounds=rrb.VisualBounds2D(x_range=shown, y_range=shown),
    )
