"""One model's recording, written as a Rerun file: scenes, demonstrations, latent maps, repairs.

Entities (coordinates: see `geometry`):

    readme                                        what one sees, in words
    fixed/{ends,table_edge}                       start and goal on the table; the table in a latent map
    training/scene_000/{image,items,kept_clear}   a training scene
    training/scene_000/{valid,invalid}/{recorded,fitted,marks}   the user's demonstrations in it
    new_items/scene_000/table/{image,items,kept_clear}           a scene with items never seen in training
    new_items/scene_000/table/repair/{first,path,ends_valid,ends_invalid}   the paths
    new_items/scene_000/latent/{predicted,truth}/map             P(valid) over z_theta: the model's, the user's
    new_items/scene_000/latent/predicted/boundary                where the truth changes
    new_items/scene_000/latent/{predicted,truth}/repair/{trail,z_theta,ends_valid,ends_invalid}   the z_theta
    new_items/scene_000/p_valid/{repairs,even_odds}              the model's P(valid)

What changes with a repair's steps lies on the time line `repair_step`, a row a step, one instance a repair.
"""

from pathlib import Path

import numpy as np
import rerun as rr

from pipeline.recording.blueprint import layout_of
from pipeline.recording.contents import Demonstrations, Repairs, Run
from pipeline.recording.geometry import crosses, on_map, on_table
from pipeline.recording.readme import page
from pipeline.recording.scene import (
    INVALID,
    VALID,
    log_boundary,
    log_fixed,
    log_map,
    log_page,
    log_table,
    recording_at,
)
from pipeline.table.bezier import curve

Array = np.ndarray
TIMELINE = "repair_step"
ABOVE, TOP = 40.0, 50.0  # draw orders of moving paths and of marks; Rerun's own end at 30 (points)
POINTS = 41  # drawn along a Bezier path
MARK, MARK_ON_MAP = 1.5, 0.7  # middle to rim of a verdict's mark, in pixels and in cells

REPAIRS = ((240, 228, 66), (86, 220, 160), (204, 121, 167), (120, 160, 255))
FIRST, EVEN_ODDS, RECORDED = (230, 97, 0, 140), (128, 128, 128), (10, 10, 10)


def write_run(path: Path, run: Run) -> None:
    """Write `run`, which shows one new scene at least, to `path` with a blueprint saved inside."""
    with recording_at(path, run.name, layout_of(run, TIMELINE)) as recording:
        log_page(recording, page(run))
        log_fixed(recording, len(run.repairs[0].truth))
        for shown in run.demonstrations:
            _demonstrations(recording, shown, run)
        for shown in run.repairs:
            _repairs(recording, shown, run)


def _static(recording: rr.RecordingStream, entity: str, what: rr.AsComponents) -> None:
    recording.log(entity, what, static=True)


def _demonstrations(recording: rr.RecordingStream, shown: Demonstrations, run: Run) -> None:
    """Valid paths are thick and carry a disc, invalid ones are thin and crossed out."""
    entity = f"training/scene_{shown.scene:03d}"
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
    """The scene, both latent maps and every repair in it over its steps."""
    entity = f"new_items/scene_{shown.scene:03d}"
    log_table(recording, f"{entity}/table", shown.image, shown.layout, run.margins)
    for name, values in (("predicted", shown.predicted), ("truth", shown.truth)):
        log_map(recording, f"{entity}/latent/{name}", values)
    log_boundary(recording, f"{entity}/latent/predicted", shown.truth)
    if shown.start:
        _repairs_on_table(recording, f"{entity}/table/repair", shown)
        for name in ("predicted", "truth"):
            _repairs_on_map(recording, f"{entity}/latent/{name}/repair", shown)
        _series(recording, f"{entity}/p_valid", shown)


def _repairs_on_table(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Every path at each step; the first ones stay in view, marks say what the truth makes of the last."""
    paths = on_table(curve(shown.z, POINTS)).swapaxes(0, 1)  # (step, repair, POINTS, 2)
    colours = _colours(shown)
    _static(recording, f"{entity}/first", rr.LineStrips2D(paths[0], colors=FIRST, radii=0.15))
    _static(recording, f"{entity}/path", rr.LineStrips2D.from_fields(colors=colours, radii=0.5, draw_order=ABOVE))
    strips = rr.LineStrips2D.columns(strips=list(paths.reshape(-1, POINTS, 2)))
    recording.send_columns(f"{entity}/path", [_steps(shown)], strips.partition([len(colours)] * len(paths)))
    _verdicts(recording, entity, paths[-1, :, POINTS // 2], shown, MARK)


def _repairs_on_map(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Every z_theta at each step, on the trail of all its steps."""
    z = on_map(shown.z, len(shown.truth))  # (repair, step, 2)
    colours, names = _colours(shown), [str(start) for start in shown.start]
    _static(recording, f"{entity}/trail", rr.LineStrips2D(z, colors=colours, radii=0.15))
    _static(
        recording,
        f"{entity}/z_theta",
        rr.Points2D.from_fields(colors=colours, labels=names, radii=0.7, draw_order=ABOVE),
    )
    positions = rr.Points2D.columns(positions=z.swapaxes(0, 1).reshape(-1, 2))
    recording.send_columns(f"{entity}/z_theta", [_steps(shown)], positions.partition([len(names)] * z.shape[1]))
    _verdicts(recording, entity, z[:, -1], shown, MARK_ON_MAP)


def _verdicts(recording: rr.RecordingStream, entity: str, ends: Array, shown: Repairs, size: float) -> None:
    """Marks that appear with the last step, in the colour and the shape of what the truth says."""
    recording.set_time(TIMELINE, sequence=shown.z.shape[1] - 1)
    for verdict, name in ((True, "ends_valid"), (False, "ends_invalid")):
        chosen = shown.ends_valid == verdict
        if chosen.any():
            recording.log(f"{entity}/{name}", _mark(ends[chosen], verdict, size))
    recording.reset_time()


def _series(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """P(valid) of every repair over its steps, and the line at 1/2 above which the model accepts."""
    steps, count = _steps(shown), shown.z.shape[1]
    names = [f"start {start}" for start in shown.start]
    style = rr.SeriesLines(names=names, colors=_colours(shown), widths=2)
    _static(recording, f"{entity}/repairs", style)
    scalars = rr.Scalars.columns(scalars=shown.p.T.astype(np.float64).ravel())
    recording.send_columns(f"{entity}/repairs", [steps], scalars.partition([len(names)] * count))
    _static(recording, f"{entity}/even_odds", rr.SeriesLines(names="even odds", colors=EVEN_ODDS, widths=1))
    even = rr.Scalars.columns(scalars=np.full(count, 0.5))
    recording.send_columns(f"{entity}/even_odds", [steps], even)


def _steps(shown: Repairs) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, sequence=np.arange(shown.z.shape[1]))


def _colours(shown: Repairs) -> list[tuple[int, int, int]]:
    """A colour a repair, the same in every view."""
    return [REPAIRS[i % len(REPAIRS)] for i in range(len(shown.start))]
