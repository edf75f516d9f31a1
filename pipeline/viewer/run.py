"""Write recordings as Rerun files: one model's, and the overview of all variants and the truth in the same new scenes.

Entities of a run (coordinates: see `scene`; {table}: image, outlines and names, see `scene.log_table`):

    about, text/{repairs,interventions,learning,training}    sources of the recording; explanation of each tab
    fixed/{titles,table_edges}                               titles and edges of a new scene's panels
    table/scene_000/{table}, {starts,paths,valid,invalid}    a new scene; the repairs, with marks at valid, invalid ends
    predicted/scene_000/{map,z_theta,lines}                  P(valid) over z_theta; the repairs' z_theta; the truth's
                                                             boundary and each repair's trail
    outcomes/scene_000/map                                   the model's verdicts against the truth (`Repairs.outcomes`)
    {p_valid,slack}/scene_000                                of the repairs: the model's P(valid); true clearance beyond
                                                             the user's margins [cm]
    {predicted,outcomes}/learning/map, losses                the first new scene's maps while the model learns
    interventions/{table,predicted,truth,...}                an item added to the first new scene, and its effects
    training/scene_000/{table}, {paths,valid,invalid}        a training scene with the user's demonstrations

Time lines: repair_step (gradient steps), intervention (added items), demonstrations and train_step (learning).

Entities of the overview:

    about, text/overview, fixed/table_edges                  as in a run
    USER/{table,titles}                                      a scene with items never seen in training; panels' titles
    USER/truth/map, USER/VARIANT/map                         which z_theta are valid; the model's verdicts against it

Its time line `scene` has one step per scene, the one with most wrong verdicts first.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy import ndarray as Array

from pipeline.legend import label
from pipeline.viewer import scene as views
from pipeline.viewer.contents import Repairs, Run, grouped
from pipeline.viewer.scene import TABLE_PIXELS, boundary, footprints, on_map, on_table
from pipeline.world.bezier import curve
from pipeline.world.rules import Margins

# The time lines of a run's recording, each with the time at which it shows the entities of the other time lines.
TIMELINES = {"repair_step": 0, "intervention": 0, "demonstrations": 1, "train_step": 0}
REPAIR, INTERVENTION, DEMONSTRATIONS, STEPS = TIMELINES
MAPS = {"predicted": (0, 1), "outcomes": (0, 2)}  # panels (row, column) of a new scene's maps, right of its table
TITLES = {(0, 0): "Table", (0, 1): "Model's P(valid)", (0, 2): "Model against truth"}
SCENE, COLUMNS = "scene", 4  # the overview's time line, and the columns of its board
FIXED = "/fixed/titles", "/fixed/table_edges"
POINTS = 13  # points drawn along a Bezier path
EVERY = 5  # of a recorded trajectory's samples, each fifth is drawn
ABOVE, TOP = 40.0, 50.0  # draw orders of moving paths and of marks; Rerun's own end at 30 (points)
MARK_RADIUS = 1.5  # radius of a mark on the table [px]
RECORDED = (10, 10, 10)  # colour (RGB) of recorded trajectories
COLOURS = ((255, 255, 255), (190, 150, 255), (80, 220, 190), (255, 160, 190))  # of repairs, the same in all views
TERMS = ((240, 228, 66), (86, 220, 160), (204, 121, 167), (120, 160, 255))  # colours of the loss terms
EFFECTS = {  # titles of the interventions' panels (row, column); the first, the unchanged scene, is logged already
    (0, 0): "Before", (1, 0): "Item added", (0, 1): "Model's P(valid), after", (0, 2): "Truth, after",
    (1, 1): "Model's effect", (1, 2): "True effect",
}  # fmt: skip
EFFECT_MAPS = {"predicted": (0, 1), "truth": (0, 2), "learned_effect": (1, 1), "true_effect": (1, 2)}
_TEMPLATES = Environment(
    loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
)
_TEMPLATES.globals |= {"label": label, "grouped": grouped}


def write_run(path: Path, run: Run) -> None:
    """Write `run`, which has at least one new scene, to `path` with its blueprint."""
    with views.recording_at(path, run.name, _layout(run)) as recording:
        tabs = ("repairs", "interventions", "learning", "training")
        views.log_texts(recording, text("about_run", run), {tab: text(tab, run) for tab in tabs})
        views.log_titles(recording, "fixed", TITLES)
        views.log_table_edges(recording, "fixed", MAPS.values())
        for name, place in MAPS.items():
            views.log_static(recording, name, views.panel(place, len(run.repairs[0].truth)))
        for shown in run.repairs:
            _log_repairs(recording, shown, run.margins)
        _log_interventions(recording, run)
        _log_learning(recording, run)
        _log_demonstrations(recording, run)


def text(name: str, *shown: Any) -> str:
    """Return the markdown text that the macro `name` of texts.md.j2 makes of a run, or of several."""
    return getattr(_TEMPLATES.get_template("texts.md.j2").module, name)(*shown)


def _layout(run: Run) -> rrb.Blueprint:
    """Return a tab per new scene, first those with repairs and with most errors, and one for each other topic."""
    tabs: list[rrb.Container] = []
    for shown in sorted(run.repairs, key=lambda shown: (not shown.start, shown.agreement)):
        scene = f"scene_{shown.scene:03d}"
        contents = (f"/{part}/{scene}/**" for part in ("table", "predicted", "outcomes"))
        parts: list[rrb.Container | rrb.View] = [views.board((1, 3), *contents, *FIXED)]
        if shown.start:
            accepted = rrb.TimeSeriesView(origin=f"p_valid/{scene}", name="Model's P(valid): accepted above 0.5")
            beyond = "True distance beyond the margin [cm]: valid above 0"
            parts.append(rrb.Horizontal(accepted, rrb.TimeSeriesView(origin=f"slack/{scene}", name=beyond)))
        name = f"New scene {shown.scene}: {1 - shown.agreement:.0%} wrong"
        tabs.append(views.beside_text(name, rrb.Vertical(*parts, row_shares=[4, 3][: len(parts)]), "repairs"))
    table = [f"/table/scene_{run.repairs[0].scene:03d}/{part}" for part in ("image", "outlines", "names")]
    effects = rrb.TextDocumentView(origin="interventions/effects", name="Effects")
    added = views.board((2, 3), *table, "/interventions/**")
    tabs.append(views.beside_text("Interventions", added, "interventions", effects))
    maps = views.board((1, 3), *table, "/predicted/learning/**", "/outcomes/learning/**", *FIXED)
    losses = rrb.TimeSeriesView(origin="losses", name="Losses, on train_step")
    tabs.append(views.beside_text("Learning", rrb.Vertical(maps, losses, row_shares=[4, 3]), "learning"))
    if run.demonstrations:
        scenes = views.board((1, len(run.demonstrations)), "/training/**")
        tabs.append(views.beside_text("Training scenes", scenes, "training"))
    return views.tabbed(run.name, tabs, rrb.TimePanel(state="collapsed", timeline=REPAIR, fps=6.0, loop_mode="all"))


def _log_repairs(recording: rr.RecordingStream, shown: Repairs, margins: Margins) -> None:
    """Log a new scene with its maps and all repairs, on the time line repair_step; the invalid starts stay visible."""
    scene, side, count = f"scene_{shown.scene:03d}", len(shown.truth), len(shown.start)
    colours = [COLOURS[i % len(COLOURS)] for i in range(count)]
    views.log_table(recording, f"table/{scene}", shown.image, shown.layout, margins)
    views.log_map(recording, f"predicted/{scene}", views.p_classes(shown.predicted))
    edges, trails = boundary(shown.truth), on_map(shown.z, side)  # trails: (repair, step, 2)
    lines = rr.LineStrips2D([*edges, *trails], colors=[*len(edges) * [views.BOUNDARY], *colours], radii=0.15)
    views.log_static(recording, f"predicted/{scene}/lines", lines)
    views.log_map(recording, f"outcomes/{scene}", views.OUTCOME + shown.outcomes)
    if not count:
        return

    paths = on_table(curve(shown.z, POINTS)).swapaxes(0, 1)  # (step, repair, POINTS, 2)
    names = [str(start) for start in shown.start]
    views.log_static(recording, f"table/{scene}/starts", rr.LineStrips2D(paths[0], colors=views.START, radii=0.2))
    for step, (lines, z_theta) in enumerate(zip(paths, trails.swapaxes(0, 1), strict=True)):
        recording.set_time(REPAIR, sequence=step)
        strips = rr.LineStrips2D(lines, colors=colours, radii=0.5, draw_order=ABOVE)
        points = rr.Points2D(z_theta, colors=colours, labels=names, radii=0.7)
        recording.log(f"table/{scene}/paths", strips)
        recording.log(f"predicted/{scene}/z_theta", points)
    _log_marks(recording, f"table/{scene}", paths[-1, :, POINTS // 2], shown.ends_valid, "still invalid")  # at the end
    recording.reset_time()
    for entity, values in ((f"p_valid/{scene}", shown.p), (f"slack/{scene}", 100 * shown.slack)):
        series = {f"start {name}": row for name, row in zip(names, values, strict=True)}
        _log_series(recording, entity, REPAIR, np.arange(values.shape[1]), series, colors=colours, widths=2)


def _log_series(
    recording: rr.RecordingStream, entity: str, timeline: str, steps: Array, series: Mapping[str, Array], **style: Any
) -> None:
    """Log the values of each named series at all `steps` of a time line at once."""
    views.log_static(recording, entity, rr.SeriesLines(names=list(series), **style))
    values = np.stack(list(series.values()), axis=-1).astype(np.float64)
    columns = rr.Scalars.columns(scalars=values.ravel()).partition([len(series)] * len(values))
    recording.send_columns(entity, [rr.TimeColumn(timeline, sequence=steps)], columns)


def _log_marks(recording: rr.RecordingStream, entity: str, centres: Array, valid: Array, word="", **when: bool) -> None:
    """Log a disc for each valid path, and a cross, with a word beside it, for each invalid one."""
    if valid.any():
        discs = rr.Points2D(centres[valid], colors=views.VALID, radii=MARK_RADIUS, draw_order=TOP)
        recording.log(f"{entity}/valid", discs, **when)
    if not valid.all():
        cross: Array = MARK_RADIUS * np.array([[-1, -1], [1, 1], [0, 0], [-1, 1], [1, -1]])
        lines, labels = [*(centres[~valid][:, None] + cross)], [word] * int((~valid).sum()) if word else None
        strips = rr.LineStrips2D(lines, colors=views.INVALID, radii=0.3 * MARK_RADIUS, draw_order=TOP, labels=labels)
        recording.log(f"{entity}/invalid", strips, **when)


def _log_interventions(recording: rr.RecordingStream, run: Run) -> None:
    """Log the effect of each added item on table, maps and E[V] in the first new scene: a step each."""
    before, entity = run.repairs[0], "interventions"
    views.log_static(recording, f"{entity}/table", views.panel((1, 0), TABLE_PIXELS))
    views.log_titles(recording, entity, EFFECTS)
    views.log_table_edges(recording, entity, EFFECT_MAPS.values())
    for step, done in enumerate(run.interventions):
        for timeline, first in TIMELINES.items():  # other time lines show the last step
            recording.set_time(timeline, sequence=step if timeline == INTERVENTION else first)
        _, outline = footprints(done.layout)[-1]
        recording.log(f"{entity}/table/image", views.jpeg(done.image))
        recording.log(f"{entity}/table/added", rr.LineStrips2D([on_table(outline)], colors=views.START, radii=0.5))
        effects = done.predicted - before.predicted, done.truth - before.truth.astype(np.float64)
        maps = [views.p_classes(done.predicted), views.p_classes(done.truth)]
        maps += [(views.EFFECT + np.round(50 * (1 + effect))).astype(np.uint8) for effect in effects]
        for (name, place), values in zip(EFFECT_MAPS.items(), maps, strict=True):
            views.log_map(recording, f"{entity}/{name}", values, views.panel(place, len(values)))
        recording.log(f"{entity}/effects", views.markdown(text("effects", run, step)))
        recording.reset_time()


def _log_learning(recording: rr.RecordingStream, run: Run) -> None:
    """Log the map of the first new scene by number of demonstrations and by training step, and every loss."""
    learning, others = run.learning, {name: first for name, first in TIMELINES.items() if name != STEPS}
    maps = [({**others, DEMONSTRATIONS: n}, predicted) for n, predicted in learning.by_n.items()]
    maps += [({STEPS: step}, predicted) for step, predicted in learning.by_step.items()]
    for times, predicted in maps:
        recording.reset_time()
        for timeline, time in times.items():
            recording.set_time(timeline, sequence=time)
        views.log_map(recording, "predicted/learning", views.p_classes(predicted))
        outcomes = replace(run.repairs[0], predicted=predicted).outcomes
        views.log_map(recording, "outcomes/learning", views.OUTCOME + outcomes)
    recording.reset_time()
    colours = [TERMS[i % len(TERMS)] for i in range(len(learning.losses))]
    _log_series(recording, "losses", STEPS, learning.step, learning.losses, colors=colours, widths=1.5)


def _log_demonstrations(recording: rr.RecordingStream, run: Run) -> None:
    """Log each training scene in its own column: the recorded trajectories over the paths fitted to them.

    Valid paths are thick with a disc, invalid ones thin with a cross.
    """
    titles = {(0, i): f"Training scene {shown.scene}" for i, shown in enumerate(run.demonstrations)}
    views.log_titles(recording, "training", titles)
    for column, shown in enumerate(run.demonstrations):
        entity = f"training/scene_{shown.scene:03d}"
        views.log_static(recording, entity, views.panel((0, column), TABLE_PIXELS))
        views.log_table(recording, entity, shown.image, shown.layout, run.margins)
        fitted = on_table(curve(shown.z, POINTS))
        recorded = [on_table(samples[::EVERY, 1:3]) for samples in shown.samples]
        colours = [*(views.VALID if valid else views.INVALID for valid in shown.valid), *len(recorded) * [RECORDED]]
        radii = [*np.where(shown.valid, 0.5, 0.25).tolist(), *len(recorded) * [0.08]]
        lines = rr.LineStrips2D([*fitted, *recorded], colors=colours, radii=radii)
        views.log_static(recording, f"{entity}/paths", lines)
        _log_marks(recording, entity, fitted[:, POINTS // 2], shown.valid, static=True)


def write_overview(path: Path, runs: Sequence[Run]) -> None:
    """Write `runs` of the same scenes, one per user and variant, to `path` with a blueprint: a tab per user."""
    users = grouped(runs, "user")
    count = 2 + max(map(len, users.values()))  # table, truth, variants
    places = [divmod(i, COLUMNS) for i in range(count)]
    shape = places[-1][0] + 1, min(count, COLUMNS)
    boards = {user: views.board(shape, f"/{user}/**", FIXED[1]) for user in users}
    tabs = [views.beside_text(f"{user} user", shown, "overview") for user, shown in boards.items()]
    time = rrb.TimePanel(state="collapsed", timeline=SCENE, play_state="paused", fps=0.5)
    with views.recording_at(path, "overview", views.tabbed("overview", tabs, time)) as recording:
        views.log_texts(recording, text("about_overview", runs), {"overview": text("overview", runs)})
        views.log_table_edges(recording, "fixed", places[1:])
        for user, of_user in users.items():
            agreement = np.mean([[shown.agreement for shown in run.repairs] for run in of_user], axis=0)
            for step, scene in enumerate(np.argsort(agreement, kind="stable").tolist()):  # the worst first
                recording.set_time(SCENE, sequence=step)
                shown = {run.variant: run.repairs[scene] for run in of_user}
                first = next(iter(shown.values()))
                titles = [f"New scene {first.scene}", "Truth"]
                titles += [f"{label(variant)}: {of_run.agreement:.0%} right" for variant, of_run in shown.items()]
                views.log_titles(recording, user, dict(zip(places, titles, strict=True)))
                views.log_table(recording, f"{user}/table", first.image, first.layout, of_user[0].margins)
                maps = {"truth": first.truth, **{variant: of_run.outcomes for variant, of_run in shown.items()}}
                for place, (name, values) in zip(places[1:], maps.items(), strict=True):
                    classes = views.OUTCOME + values.astype(np.uint8)
                    views.log_map(recording, f"{user}/{name}", classes, views.panel(place, len(values)))
