"""Write recordings as Rerun files: one model's, and the overview of all variants and the truth in the same new scenes.

Entities of a run (coordinates: see `scene`; {table}: image, outlines and names, see `scene.log_table`):

    about, text/{repairs,interventions,learning,training}    sources of the recording; explanation of each tab
    fixed/{titles,table_edges}                               titles and edges of a new scene's panels
    table/{table}, {starts,paths,valid,invalid}, title       a new scene; the repairs, with marks at valid, invalid ends
    predicted/{map,z_theta,lines}                            P(valid) over z_theta; the repairs' z_theta; the truth's
                                                             boundary and each repair's trail
    outcomes/map                                             the model's verdicts against the truth (`Shown.outcomes`)
    log_odds, slack                                          of the repairs: the model's log-odds of being valid; true
                                                             clearance beyond the user's margins [cm]
    first/{table}, {predicted,outcomes}/learning/map, losses the first new scene, and its maps while the model learns
    interventions/{table,predicted,truth,...}                an item added to the first new scene, and its effects
    effects/{scene,mean}                                     the effects as numbers: of the model, and true
    training/{0,1,...}/{table}, {paths,valid,invalid}        a training scene with the user's demonstrations

Properties, columns of Rerun's catalog: `run` (who, and how well over all new scenes) and `worst` (of each worst scene:
its number, its last step on repair_step, the share of its map that is wrong, and the number of its unsafe repairs).

Time lines: repair_step (gradient steps of one worst scene after another), intervention (added items), demonstrations
and train_step (learning).

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

# The time lines of a run's recording, each with the time at which it shows the entities of the other time lines.
TIMELINES = {"repair_step": 0, "intervention": 0, "demonstrations": 1, "train_step": 0}
REPAIR, INTERVENTION, DEMONSTRATIONS, STEPS = TIMELINES
MAPS = {"predicted": (0, 1), "outcomes": (0, 2)}  # panels (row, column) of a new scene's maps, right of its table
TITLES = {(0, 1): "Model's P(valid)", (0, 2): "Model against truth"}
SCENE_TITLE = views.TITLE[None]  # of the panel with the table, which names the scene
OVERVIEW = "overview"  # name of its recording
SCENE, COLUMNS = "scene", 4  # the overview's time line, and the columns of its board
FIXED = "/fixed/titles", "/fixed/table_edges"
POINTS = 13  # points drawn along a Bezier path
EVERY = 5  # of a recorded trajectory's samples, each fifth is drawn
ABOVE, TOP = 40.0, 50.0  # draw orders of moving paths and of marks; Rerun's own end at 30 (points)
MARK_RADIUS = 1.5  # radius of a mark on the table [px]
RECORDED = (10, 10, 10)  # colour (RGB) of recorded trajectories
COLOURS = ((150, 200, 60), (190, 150, 255), (80, 220, 190), (255, 160, 190))  # of repairs, the same in all views
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
    """Write `run`, which has at least one new scene, to `path` with its blueprint and its properties."""
    with views.recording_at(path, run.name, layout(len(run.demonstrations))) as recording:
        for name, facts in properties(run).items():
            recording.send_property(name, rr.AnyValues(drop_untyped_nones=True, **facts))
        tabs = ("repairs", "interventions", "learning", "training")
        views.log_texts(recording, text("about_run", run), {tab: text(tab, run) for tab in tabs})
        views.log_titles(recording, "fixed", TITLES)
        views.log_table_edges(recording, "fixed", MAPS.values())
        for name, place in MAPS.items():
            recording.log(name, views.panel(place, len(run.shown[0].truth)), static=True)
        first = run.shown[0]
        views.log_table(recording, "first", first.image, first.layout, run.margins, static=True)
        for rank in range(len(run.repairs)):
            _log_repairs(recording, run, rank)
        _log_steps(recording, run.repairs)
        _log_interventions(recording, run)
        _log_learning(recording, run)
        _log_demonstrations(recording, run)


def properties(run: Run) -> dict[str, dict[str, Any]]:
    """Return what Rerun's catalog shows of a run, by property and column."""
    who = {"variant": run.variant, "user": run.user, "seed": run.seed, "n_demos": run.n_demos}
    source = {"profile": run.profile, "data_version": run.data, "source": f"simulated, root seed {run.root_seed}"}
    worst = {
        "scene": [shown.scene for shown in run.repairs],
        "step": [run.first_step(rank + 1) - 2 for rank in range(len(run.repairs))],
        "wrong": [round(1 - shown.agreement, 3) for shown in run.repairs],
        "unsafe_repairs": [shown.unsafe for shown in run.repairs],
    }
    return {"run": who | run.facts | source} | ({"worst": worst} if run.repairs else {})


def text(name: str, *shown: Any) -> str:
    """Return the markdown text that the macro `name` of texts.md.j2 makes of a run, or of several."""
    return getattr(_TEMPLATES.get_template("texts.md.j2").module, name)(*shown)


def layout(training_scenes: int) -> rrb.Blueprint:
    """Return the tabs of every run: its worst scenes, and one for each other topic."""
    scenes = views.board(
        (1, 3), "/table/**", *(f"/predicted/{x}" for x in ("map", "lines", "z_theta")), "/outcomes/map", *FIXED
    )
    accepted = rrb.TimeSeriesView(origin="log_odds", name="Model's log-odds of valid: accepted above 0")
    beyond = rrb.TimeSeriesView(origin="slack", name="True distance beyond the margin [cm]: valid above 0")
    worst = rrb.Vertical(scenes, rrb.Horizontal(accepted, beyond), row_shares=[4, 3])
    tabs: list[rrb.Container] = [views.beside_text("Worst scenes", worst, "repairs")]
    effects = rrb.TextDocumentView(origin="interventions/effects", name="Effects")
    added = views.board((2, 3), "/first/**", "/interventions/**")
    tabs.append(views.beside_text("Interventions", added, "interventions", effects))
    maps = views.board((1, 3), "/first/**", "/predicted/learning/**", "/outcomes/learning/**", *FIXED)
    losses = rrb.TimeSeriesView(origin="losses", name="Losses, on train_step")
    tabs.append(views.beside_text("Learning", rrb.Vertical(maps, losses, row_shares=[4, 3]), "learning"))
    if training_scenes:
        tabs.append(views.beside_text("Training scenes", views.board((1, training_scenes), "/training/**"), "training"))
    return views.tabbed("run", tabs, rrb.TimePanel(state="collapsed", timeline=REPAIR, fps=6.0, loop_mode="all"))


def _log_repairs(recording: rr.RecordingStream, run: Run, rank: int) -> None:
    """Log one of the worst scenes with its maps and all repairs, on repair_step; the invalid starts stay visible."""
    shown, begin = run.repairs[rank], run.first_step(rank)
    side, count = len(shown.truth), len(shown.start)
    colours = [COLOURS[i % len(COLOURS)] for i in range(count)]
    for timeline, time in TIMELINES.items():  # other time lines show the worst scene
        if timeline == REPAIR or not rank:
            recording.set_time(timeline, sequence=begin if timeline == REPAIR else time)
    views.log_table(recording, "table", shown.image, shown.layout, run.margins)
    title = f"Scene {shown.scene}, number {rank + 1} of the worst: {1 - shown.agreement:.0%} wrong"
    recording.log("table/title", rr.Points2D(SCENE_TITLE, labels=[title], colors=views.ITEM, radii=0))
    views.log_map(recording, "predicted", views.p_classes(shown.predicted))
    edges, trails = boundary(shown.truth), on_map(shown.z, side)  # trails: (repair, step, 2)
    lines = rr.LineStrips2D([*edges, *trails], colors=[*len(edges) * [views.BOUNDARY], *colours], radii=0.15)
    recording.log("predicted/lines", lines)
    views.log_map(recording, "outcomes", views.OUTCOME + shown.outcomes)
    paths = on_table(curve(shown.z, POINTS)).swapaxes(0, 1)  # (step, repair, POINTS, 2)
    names = [str(start) for start in shown.start]
    recording.log("table/starts", rr.LineStrips2D(paths[0], colors=views.START, radii=0.2))
    for mark in ("valid", "invalid"):  # of the scene before
        recording.log(f"table/{mark}", rr.Clear(recursive=False))
    for step, (lines, z_theta) in enumerate(zip(paths, trails.swapaxes(0, 1), strict=True)):
        recording.set_time(REPAIR, sequence=begin + step)
        strips = rr.LineStrips2D(lines, colors=colours, radii=0.5, draw_order=ABOVE)
        points = rr.Points2D(z_theta, colors=colours, labels=names, radii=0.7)
        recording.log("table/paths", strips)
        recording.log("predicted/z_theta", points)
    _log_marks(recording, "table", paths[-1, :, POINTS // 2], shown.ends_valid, "still invalid")  # at the end
    recording.reset_time()


def _log_steps(recording: rr.RecordingStream, repairs: Sequence[Repairs]) -> None:
    """Log log-odds and true slack of all repairs at all steps, the first repair of every scene as one series."""
    if not repairs:
        return
    count, steps = max(len(shown.start) for shown in repairs), repairs[0].log_odds.shape[1] + 1
    for entity, scale in (("log_odds", 1), ("slack", 100)):
        values = np.full((count, len(repairs), steps), np.nan)  # a gap after each scene
        for rank, shown in enumerate(repairs):
            values[: len(shown.start), rank, :-1] = scale * getattr(shown, entity)
        series = {f"repair {i + 1}": row.ravel() for i, row in enumerate(values)}
        _log_series(
            recording, entity, REPAIR, np.arange(len(repairs) * steps), series, colors=COLOURS[:count], widths=2
        )


def _log_series(
    recording: rr.RecordingStream, entity: str, timeline: str, steps: Array, series: Mapping[str, Array], **style: Any
) -> None:
    """Log the values of each named series at all `steps` of a time line at once."""
    recording.log(entity, rr.SeriesLines(names=list(series), **style), static=True)
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
    before, entity = run.shown[0], "interventions"
    recording.log(f"{entity}/table", views.panel((1, 0), TABLE_PIXELS), static=True)
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
    for name, suffix in (("scene", ""), ("mean", "_mean")) if run.interventions else ():
        sides = {"model": "learned", "truth": "true"}
        series = {k: np.array([getattr(done, v + suffix) for done in run.interventions]) for k, v in sides.items()}
        _log_series(recording, f"effects/{name}", INTERVENTION, np.arange(len(run.interventions)), series)


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
        outcomes = replace(run.shown[0], predicted=predicted).outcomes
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
        entity = f"training/{column}"
        recording.log(entity, views.panel((0, column), TABLE_PIXELS), static=True)
        views.log_table(recording, entity, shown.image, shown.layout, run.margins)
        fitted = on_table(curve(shown.z, POINTS))
        recorded = [on_table(samples[::EVERY, 1:3]) for samples in shown.samples]
        colours = [*(views.VALID if valid else views.INVALID for valid in shown.valid), *len(recorded) * [RECORDED]]
        radii = [*np.where(shown.valid, 0.5, 0.25).tolist(), *len(recorded) * [0.08]]
        lines = rr.LineStrips2D([*fitted, *recorded], colors=colours, radii=radii)
        recording.log(f"{entity}/paths", lines, static=True)
        _log_marks(recording, entity, fitted[:, POINTS // 2], shown.valid, static=True)


def overview_layout(users: Sequence[str], variants: int) -> rrb.Blueprint:
    """Return the tabs of an overview of that many variants: one for each user."""
    shape = (1 + variants) // COLUMNS + 1, min(2 + variants, COLUMNS)  # panels: table, truth, each variant
    boards = {user: views.board(shape, f"/{user}/**", FIXED[1]) for user in users}
    tabs = [views.beside_text(f"{user} user", shown, "overview") for user, shown in boards.items()]
    time = rrb.TimePanel(state="collapsed", timeline=SCENE, play_state="paused", fps=0.5)
    return views.tabbed(OVERVIEW, tabs, time)


def write_overview(path: Path, runs: Sequence[Run]) -> None:
    """Write `runs` of the same scenes, one per user and variant, to `path` with a blueprint: a tab per user."""
    users = grouped(runs, "user")
    places = [divmod(i, COLUMNS) for i in range(2 + max(map(len, users.values())))]
    with views.recording_at(path, OVERVIEW, overview_layout(list(users), len(places) - 2)) as recording:
        views.log_texts(recording, text("about_overview", runs), {"overview": text("overview", runs)})
        views.log_table_edges(recording, "fixed", places[1:])
        for user, of_user in users.items():
            agreement = np.mean([[shown.agreement for shown in run.shown] for run in of_user], axis=0)
            for step, scene in enumerate(np.argsort(agreement, kind="stable").tolist()):  # the worst first
                recording.set_time(SCENE, sequence=step)
                shown = {run.variant: run.shown[scene] for run in of_user}
                first = next(iter(shown.values()))
                titles = [f"New scene {first.scene}", "Truth"]
                titles += [f"{label(variant)}: {of_run.agreement:.0%} right" for variant, of_run in shown.items()]
                views.log_titles(recording, user, dict(zip(places, titles, strict=True)))
                views.log_table(recording, f"{user}/table", first.image, first.layout, of_user[0].margins)
                maps = {"truth": first.truth, **{variant: of_run.outcomes for variant, of_run in shown.items()}}
                for place, (name, values) in zip(places[1:], maps.items(), strict=True):
                    classes = views.OUTCOME + values.astype(np.uint8)
                    views.log_map(recording, f"{user}/{name}", classes, views.panel(place, len(values)))
