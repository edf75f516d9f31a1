"""One model's recording, written as a Rerun file: scenes, demonstrations, latent maps, repairs, and what-ifs.

Entities (coordinates: see `geometry`):

    readme                                        what one sees, in words
    fixed/{ends,titles,table_edge}                start and goal on the table; what the panels of a new scene are
    fixed/even_odds                               the line above which the model accepts a path
    training/scene_000/{image,items,kept_clear}   a training scene
    training/scene_000/{valid,invalid}/{recorded,fitted,marks}   the user's demonstrations in it
    new_items/scene_000/table/{image,items,kept_clear}           a scene with items never seen in training
    new_items/scene_000/table/repair/{first,path,ends_valid,ends_invalid}   the paths
    new_items/scene_000/latent/{predicted,truth}/map             P(valid) over z_theta: the model's, the user's
    new_items/scene_000/latent/difference/map                    the model's less the user's
    new_items/scene_000/latent/{predicted,difference}/learning/map   the same on the way there (see `learning`)
    new_items/scene_000/latent/predicted/boundary                where the truth changes
    new_items/scene_000/latent/{predicted,truth}/repair/{trail,z_theta,ends_valid,ends_invalid}   the z_theta
    new_items/scene_000/p_valid/repairs                          the model's P(valid)
    new_items/scene_000/slack/repairs                            how far outside the user's margins it truly is [cm]
    interventions, counterfactuals                see the modules of these names
    losses                                        of the model's training

What changes with a repair's steps lies on the time line `repair_step`, a row a step, one instance a repair.
"""

from pathlib import Path

import numpy as np
import rerun as rr

from pipeline.viewer.blueprint import layout_of
from pipeline.viewer.board import SCENE_MAPS, SCENE_TITLES, log_titles, panel
from pipeline.viewer.contents import Demonstrations, Repairs, Run
from pipeline.viewer.counterfactuals import log_counterfactuals
from pipeline.viewer.geometry import TABLE_PIXELS, crosses, on_map, on_table
from pipeline.viewer.interventions import log_interventions
from pipeline.viewer.learning import log_learning
from pipeline.viewer.readme import page
from pipeline.viewer.scene import (
    DIFFERENCES,
    INVALID,
    VALID,
    log_boundary,
    log_difference,
    log_ends,
    log_map,
    log_page,
    log_table,
    recording_at,
)
from pipeline.world.bezier import curve

Array = np.ndarray
TIMELINE = "repair_step"
ABOVE, TOP = 40.0, 50.0  # draw orders of moving paths and of marks; Rerun's own end at 30 (points)
POINTS = 13  # drawn along a Bezier path
MARK, MARK_ON_MAP = 1.5, 0.7  # middle to rim of a verdict's mark, in pixels and in cells

REPAIRS = ((240, 228, 66), (86, 220, 160), (204, 121, 167), (120, 160, 255))
FIRST, EVEN_ODDS, RECORDED = (230, 97, 0, 140), (128, 128, 128), (10, 10, 10)


def write_run(path: Path, run: Run) -> None:
    """Write `run`, which shows one new scene at least, to `path` with a blueprint saved inside."""
    with recording_at(path, run.name, layout_of(run, TIMELINE)) as recording:
        log_page(recording, page(run))
        log_ends(recording)
        log_titles(recording, "fixed", SCENE_TITLES, list(SCENE_MAPS.values()))
        _even_odds(recording, run.repairs[0])
        recording.log("/", rr.AnnotationContext(DIFFERENCES), static=True)
        log_titles(
            recording, "training", {(0, i): f"Training scene {x.scene}" for i, x in enumerate(run.demonstrations)}
        )
        for column, shown in enumerate(run.demonstrations):
            _demonstrations(recording, shown, run, column)
        for shown in run.repairs:
            _repairs(recording, shown, run)
        log_interventions(recording, run)
        if run.counterfactuals:
            log_counterfactuals(recording, run)
        log_learning(recording, run)


def _static(recording: rr.RecordingStream, entity: str, what: rr.AsComponents) -> None:
    recording.log(entity, what, static=True)


def _demonstrations(recording: rr.RecordingStream, shown: Demonstrations, run: Run, column: int) -> None:
    """Valid paths are thick and carry a disc, invalid ones are thin and crossed out."""
    entity = f"training/scene_{shown.scene:03d}"
    _static(recording, entity, panel((0, column), TABLE_PIXELS))
    log_table(recording, entity, shown.image, shown.layout, run.margins)
    for verdict, colour, radius in ((True, VALID, 0.45), (False, INVALID, 0.2)):
        chosen = np.flatnonzero(shown.valid == verdict)
        if len(chosen) == 0:
            continue
        under = f"{entity}/{'valid' if verdict else 'invalid'}"
        raw = [on_table(shown.samples[i][:, 1:3]) for i in chosen]
        fitted = on_table(curve(shown.z[chosen], POINTS))
        _static(
            recording,
            f"{under}/recorded",
            rr.LineStrips2D(raw, colors=RECORDED, radii=0.08, draw_order=ABOVE),
        )
        _static(recording, f"{under}/fitted", rr.LineStrips2D(fitted, colors=colour, radii=radius))
        _static(recording, f"{under}/marks", _mark(fitted[:, POINTS // 2], verdict, MARK))


def _mark(centres: Array, verdict: bool, size: float) -> rr.AsComponents:
    """A disc for valid, a cross for invalid, `size` from middle to rim."""
    if verdict:
        return rr.Points2D(centres, colors=VALID, radii=size, draw_order=TOP)
    return rr.LineStrips2D(crosses(centres, size), colors=INVALID, radii=0.3 * size, draw_order=TOP)


def _repairs(recording: rr.RecordingStream, shown: Repairs, run: Run) -> None:
    """The scene, its latent maps and every repair in it over its steps."""
    entity = f"new_items/scene_{shown.scene:03d}"
    log_table(recording, f"{entity}/table", shown.image, shown.layout, run.margins)
    for name, values in (("predicted", shown.predicted), ("truth", shown.truth)):
        _static(recording, f"{entity}/latent/{name}", panel(SCENE_MAPS[name], len(shown.truth)))
        log_map(recording, f"{entity}/latent/{name}", values)
    log_boundary(recording, f"{entity}/latent/predicted", shown.truth)
    place = panel(SCENE_MAPS["difference"], len(shown.truth))
    log_difference(recording, f"{entity}/latent/difference", shown.predicted - shown.truth, place)
    if shown.start:
        _repairs_on_table(recording, f"{entity}/table/repair", shown)
        for name in ("predicted", "truth"):
            _repairs_on_map(recording, f"{entity}/latent/{name}/repair", shown)
        _series(recording, f"{entity}/p_valid/repairs", shown, shown.p)
        _series(recording, f"{entity}/slack/repairs", shown, 100 * shown.slack)


def _repairs_on_table(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Every path at each step; the first ones stay in view, marks say what the truth makes of the last."""
    paths = on_table(curve(shown.z, POINTS)).swapaxes(0, 1)  # (step, repair, POINTS, 2)
    colours = _colours(shown)
    _static(recording, f"{entity}/first", rr.LineStrips2D(paths[0], colors=FIRST, radii=0.15))
    for step, at_step in enumerate(paths):
        recording.set_time(TIMELINE, sequence=step)
        strips = rr.LineStrips2D(at_step, colors=colours, radii=0.5, draw_order=ABOVE)
        recording.log(f"{entity}/path", strips)
    recording.reset_time()
    _verdicts(recording, entity, paths[-1, :, POINTS // 2], shown, MARK)


def _repairs_on_map(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Every z_theta at each step, on the trail of all its steps."""
    z = on_map(shown.z, len(shown.truth))  # (repair, step, 2)
    colours, names = _colours(shown), [str(start) for start in shown.start]
    _static(recording, f"{entity}/trail", rr.LineStrips2D(z, colors=colours, radii=0.15))
    for step, at_step in enumerate(z.swapaxes(0, 1)):
        recording.set_time(TIMELINE, sequence=step)
        points = rr.Points2D(at_step, colors=colours, labels=names, radii=0.7)
        recording.log(f"{entity}/z_theta", points)
    recording.reset_time()
    _verdicts(recording, entity, z[:, -1], shown, MARK_ON_MAP)


def _verdicts(recording: rr.RecordingStream, entity: str, ends: Array, shown: Repairs, size: float) -> None:
    """Marks that appear with the last step, in the colour and the shape of what the truth says."""
    recording.set_time(TIMELINE, sequence=shown.z.shape[1] - 1)
    for verdict, name in ((True, "ends_valid"), (False, "ends_invalid")):
        chosen = shown.ends_valid == verdict
        if chosen.any():
            recording.log(f"{entity}/{name}", _mark(ends[chosen], verdict, size))
    recording.reset_time()


def _series(recording: rr.RecordingStream, entity: str, shown: Repairs, values: Array) -> None:
    """A value (repair, step) of every repair over its steps."""
    names = [f"start {start}" for start in shown.start]
    _static(recording, entity, rr.SeriesLines(names=names, colors=_colours(shown), widths=2))
    scalars = rr.Scalars.columns(scalars=values.T.astype(np.float64).ravel())
    recording.send_columns(entity, [_steps(shown)], scalars.partition([len(names)] * shown.z.shape[1]))


def _even_odds(recording: rr.RecordingStream, shown: Repairs) -> None:
    """The line above which the model accepts."""
    _static(recording, "fixed/even_odds", rr.SeriesLines(names="even odds", colors=EVEN_ODDS, widths=1))
    even = rr.Scalars.columns(scalars=np.full(shown.z.shape[1], 0.5))
    recording.send_columns("fixed/even_odds", [_steps(shown)], even)


def _steps(shown: Repairs) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, sequence=np.arange(shown.z.shape[1]))


def _colours(shown: Repairs) -> list[tuple[int, int, int]]:
    """A colour a repair, the same in every view."""
    return [REPAIRS[i % len(REPAIRS)] for i in range(len(shown.start))]
