"""Write one model's recording as a Rerun file.

Entities (coordinates: see `geometry`; {table}: image, outlines and names, see `scene.log_table`):

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
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from numpy import ndarray as Array

from pipeline.legend import label
from pipeline.viewer.blueprint import beside_text, board, tabbed
from pipeline.viewer.contents import Repairs, Run, grouped
from pipeline.viewer.geometry import TABLE_PIXELS, boundary, crosses, footprints, on_map, on_table
from pipeline.viewer.scene import (
    BOUNDARY,
    INVALID,
    MAPS,
    OUTCOME,
    START,
    TIMELINES,
    TITLES,
    VALID,
    effect_classes,
    jpeg,
    log_map,
    log_static,
    log_table,
    log_table_edges,
    log_texts,
    log_titles,
    markdown,
    p_classes,
    panel,
    recording_at,
    scene_name,
    set_time,
)  # fmt: skip
from pipeline.world.bezier import curve

REPAIR, INTERVENTION, DEMONSTRATIONS, STEPS = TIMELINES  # the time lines
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
    with recording_at(path, run.name, _layout(run)) as recording:
        tabs = ("repairs", "interventions", "learning", "training")
        log_texts(recording, text("about_run", run), {tab: text(tab, run) for tab in tabs})
        log_titles(recording, "fixed", TITLES)
        log_table_edges(recording, "fixed", MAPS.values())
        for name, place in MAPS.items():
            log_static(recording, name, panel(place, len(run.repairs[0].truth)))
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
        scene = scene_name(shown.scene)
        views: list[rrb.Container | rrb.View] = [
            board((1, 3), *(f"/{part}/{scene}/**" for part in ("table", "predicted", "outcomes")), *FIXED)
        ]
        if shown.start:
            accepted = rrb.TimeSeriesView(origin=f"p_valid/{scene}", name="Model's P(valid): accepted above 0.5")
            slack = rrb.TimeSeriesView(
                origin=f"slack/{scene}", name="True distance beyond the margin [cm]: valid above 0"
            )
            views.append(rrb.Horizontal(accepted, slack))
        name = f"New scene {shown.scene}: {1 - shown.agreement:.0%} wrong"
        tabs.append(beside_text(name, rrb.Vertical(*views, row_shares=[4, 3][: len(views)]), "repairs"))
    table = [f"/table/{scene_name(run.repairs[0].scene)}/{part}" for part in ("image", "outlines", "names")]
    effects = rrb.TextDocumentView(origin="interventions/effects", name="Effects")
    tabs.append(beside_text("Interventions", board((2, 3), *table, "/interventions/**"), "interventions", effects))
    maps = board((1, 3), *table, "/predicted/learning/**", "/outcomes/learning/**", *FIXED)
    losses = rrb.TimeSeriesView(origin="losses", name="Losses, on train_step")
    tabs.append(beside_text("Learning", rrb.Vertical(maps, losses, row_shares=[4, 3]), "learning"))
    if run.demonstrations:
        scenes = board((1, len(run.demonstrations)), "/training/**")
        tabs.append(beside_text("Training scenes", scenes, "training"))
    return tabbed(run.name, tabs, rrb.TimePanel(state="collapsed", timeline=REPAIR, fps=6.0, loop_mode="all"))


def _log_repairs(recording: rr.RecordingStream, shown: Repairs, margins: Mapping[str, float | None]) -> None:
    """Log a new scene with its maps and all repairs, on the time line repair_step; the invalid starts stay visible."""
    scene, side, count = scene_name(shown.scene), len(shown.truth), len(shown.start)
    colours = [COLOURS[i % len(COLOURS)] for i in range(count)]
    log_table(recording, f"table/{scene}", shown.image, shown.layout, margins)
    log_map(recording, f"predicted/{scene}", p_classes(shown.predicted))
    edges, trails = boundary(shown.truth), on_map(shown.z, side)  # trails: (repair, step, 2)
    of_lines = [*len(edges) * [BOUNDARY], *colours]
    log_static(recording, f"predicted/{scene}/lines", rr.LineStrips2D([*edges, *trails], colors=of_lines, radii=0.15))
    log_map(recording, f"outcomes/{scene}", OUTCOME + shown.outcomes)
    if not count:
        return

    paths = on_table(curve(shown.z, POINTS)).swapaxes(0, 1)  # (step, repair, POINTS, 2)
    names = [str(start) for start in shown.start]
    log_static(recording, f"table/{scene}/starts", rr.LineStrips2D(paths[0], colors=START, radii=0.2))
    for step, (lines, z_theta) in enumerate(zip(paths, trails.swapaxes(0, 1), strict=True)):
        recording.set_time(REPAIR, sequence=step)
        strips = rr.LineStrips2D(lines, colors=colours, radii=0.5, draw_order=ABOVE)
        recording.log(f"table/{scene}/paths", strips)
        points = rr.Points2D(z_theta, colors=colours, labels=names, radii=0.7)
        recording.log(f"predicted/{scene}/z_theta", points)
    for valid, end in ((True, "valid"), (False, "invalid")):  # at the last step
        if (chosen := shown.ends_valid == valid).any():
            centres = paths[-1, chosen, POINTS // 2]
            recording.log(f"table/{scene}/{end}", _mark(centres, valid, None if valid else "still invalid"))
    recording.reset_time()
    for entity, values in ((f"p_valid/{scene}", shown.p), (f"slack/{scene}", 100 * shown.slack)):
        named = [f"start {name}" for name in names]
        log_static(recording, entity, rr.SeriesLines(names=named, colors=colours, widths=2))
        _send_series(recording, entity, REPAIR, np.arange(values.shape[1]), values.T)


def _send_series(recording: rr.RecordingStream, entity: str, timeline: str, steps: Array, values: Array) -> None:
    """Log `values` (step, series) at all `steps` of a time line at once."""
    scalars = rr.Scalars.columns(scalars=values.astype(np.float64).ravel())
    columns = scalars.partition([values.shape[1]] * len(values))
    recording.send_columns(entity, [rr.TimeColumn(timeline, sequence=steps)], columns)


def _mark(centres: Array, valid: bool, label: str | None = None) -> rr.AsComponents:
    """Return a disc for each valid path and a cross for each invalid one, with a label."""
    labels = None if label is None else [label] * len(centres)
    if valid:
        return rr.Points2D(centres, colors=VALID, radii=MARK_RADIUS, draw_order=TOP, labels=labels)
    lines = crosses(centres, MARK_RADIUS)
    return rr.LineStrips2D(lines, colors=INVALID, radii=0.3 * MARK_RADIUS, draw_order=TOP, labels=labels)


def _log_interventions(recording: rr.RecordingStream, run: Run) -> None:
    """Log the effect of each added item on table, maps and E[V] in the first new scene: a step each."""
    before, entity = run.repairs[0], "interventions"
    log_static(recording, f"{entity}/table", panel((1, 0), TABLE_PIXELS))
    log_titles(recording, entity, EFFECTS)
    log_table_edges(recording, entity, EFFECT_MAPS.values())
    for step, done in enumerate(run.interventions):
        set_time(recording, INTERVENTION, step)
        _, outline = footprints(done.layout)[-1]
        recording.log(f"{entity}/table/image", jpeg(done.image))
        recording.log(f"{entity}/table/added", rr.LineStrips2D([on_table(outline)], colors=START, radii=0.5))
        maps = {
            "predicted": p_classes(done.predicted),
            "truth": p_classes(done.truth),
            "learned_effect": effect_classes(done.predicted - before.predicted),
            "true_effect": effect_classes(done.truth - before.truth.astype(np.float64)),
        }
        for name, values in maps.items():
            log_map(recording, f"{entity}/{name}", values, panel(EFFECT_MAPS[name], len(values)))
        recording.log(f"{entity}/effects", markdown(text("effects", run, step)))
        recording.reset_time()


def _log_learning(recording: rr.RecordingStream, run: Run) -> None:
    """Log the map of the first new scene by number of demonstrations and by training step, and every loss."""
    learning = run.learning
    others = {timeline: first for timeline, first in TIMELINES.items() if timeline != STEPS}
    maps = [({**others, DEMONSTRATIONS: n}, predicted) for n, predicted in learning.by_n.items()]
    maps += [({STEPS: step}, predicted) for step, predicted in learning.by_step.items()]
    for times, predicted in maps:
        recording.reset_time()
        for timeline, time in times.items():
            recording.set_time(timeline, sequence=time)
        log_map(recording, "predicted/learning", p_classes(predicted))
        log_map(recording, "outcomes/learning", OUTCOME + replace(run.repairs[0], predicted=predicted).outcomes)
    recording.reset_time()
    terms = list(learning.losses)
    colours = [TERMS[i % len(TERMS)] for i in range(len(terms))]
    log_static(recording, "losses", rr.SeriesLines(names=terms, colors=colours, widths=1.5))
    _send_series(recording, "losses", STEPS, learning.step, np.stack(list(learning.losses.values()), axis=-1))


def _log_demonstrations(recording: rr.RecordingStream, run: Run) -> None:
    """Log each training scene in its own column: the recorded trajectories over the paths fitted to them.

    Valid paths are thick with a disc, invalid ones thin with a cross.
    """
    titles = {(0, i): f"Training scene {shown.scene}" for i, shown in enumerate(run.demonstrations)}
    log_titles(recording, "training", titles)
    for column, shown in enumerate(run.demonstrations):
        entity = f"training/{scene_name(shown.scene)}"
        log_static(recording, entity, panel((0, column), TABLE_PIXELS))
        log_table(recording, entity, shown.image, shown.layout, run.margins)
        fitted = on_table(curve(shown.z, POINTS))
        recorded = [on_table(samples[::EVERY, 1:3]) for samples in shown.samples]
        colours = [*(VALID if valid else INVALID for valid in shown.valid), *len(recorded) * [RECORDED]]
        radii = [*np.where(shown.valid, 0.5, 0.25).tolist(), *len(recorded) * [0.08]]
        log_static(recording, f"{entity}/paths", rr.LineStrips2D([*fitted, *recorded], colors=colours, radii=radii))
        for valid, name in ((True, "valid"), (False, "invalid")):
            if (chosen := shown.valid == valid).any():
                log_static(recording, f"{entity}/{name}", _mark(fitted[chosen, POINTS // 2], valid))
