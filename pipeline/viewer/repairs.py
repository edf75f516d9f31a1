"""Log new scenes and the model's gradient repairs, on the time line `repair_step`: one step per gradient step.

new_items/scene_000/table/{image,items,kept_clear}             the scene
new_items/scene_000/table/repair/{first,path,ends_valid,ends_invalid}   the paths
new_items/scene_000/latent/{predicted,truth}/map               P(valid) over z_theta: the model's, the user's
new_items/scene_000/latent/difference/map                      the model's minus the user's
new_items/scene_000/latent/predicted/boundary                  the boundary of the truth
new_items/scene_000/latent/{predicted,truth}/repair/{trail,z_theta,ends_valid,ends_invalid}   the z_theta
new_items/scene_000/p_valid/repairs                            the model's P(valid)
new_items/scene_000/slack/repairs                              true clearance in excess of the user's margins [cm]
"""

import numpy as np
import rerun as rr
from numpy import ndarray as Array

from pipeline.viewer.contents import Repairs, Run
from pipeline.viewer.demonstrations import ABOVE, MARK_RADIUS, POINTS, mark
from pipeline.viewer.geometry import on_map, on_table
from pipeline.viewer.scene import (
    SCENE_MAPS,
    log_boundary,
    log_difference,
    log_map,
    log_static,
    log_table,
    panel,
)
from pipeline.world.bezier import curve

TIMELINE = "repair_step"
MAP_MARK_RADIUS = 0.7  # radius of a mark on a map [cells]
COLOURS = ((240, 228, 66), (86, 220, 160), (204, 121, 167), (120, 160, 255))  # of repairs, the same in all views
FIRST, EVEN_ODDS = (230, 97, 0, 140), (128, 128, 128)  # colours of starts and of p = 0.5


def log_repairs(recording: rr.RecordingStream, run: Run) -> None:
    """Log every new scene with its maps and all repairs."""
    steps = run.repairs[0].z.shape[1]
    log_static(recording, "fixed/even_odds", rr.SeriesLines(names="even odds", colors=EVEN_ODDS, widths=1))
    recording.send_columns("fixed/even_odds", [_steps(steps)], rr.Scalars.columns(scalars=np.full(steps, 0.5)))
    for shown in run.repairs:
        entity = f"new_items/scene_{shown.scene:03d}"
        log_table(recording, f"{entity}/table", shown.image, shown.layout, run.margins)
        for name, values in (("predicted", shown.predicted), ("truth", shown.truth)):
            log_static(recording, f"{entity}/latent/{name}", panel(SCENE_MAPS[name], len(shown.truth)))
            log_map(recording, f"{entity}/latent/{name}", values)
        log_boundary(recording, f"{entity}/latent/predicted", shown.truth)
        place = panel(SCENE_MAPS["difference"], len(shown.truth))
        log_difference(recording, f"{entity}/latent/difference", shown.predicted - shown.truth, place)
        if shown.start:
            _log_paths(recording, f"{entity}/table/repair", shown)
            for name in ("predicted", "truth"):
                _log_z_theta(recording, f"{entity}/latent/{name}/repair", shown)
            _log_series(recording, f"{entity}/p_valid/repairs", shown, shown.p)
            _log_series(recording, f"{entity}/slack/repairs", shown, 100 * shown.slack)


def _log_paths(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Log the paths at each step; the invalid starts stay visible."""
    paths = on_table(curve(shown.z, POINTS)).swapaxes(0, 1)  # (step, repair, POINTS, 2)
    log_static(recording, f"{entity}/first", rr.LineStrips2D(paths[0], colors=FIRST, radii=0.15))
    for step, lines in enumerate(paths):
        recording.set_time(TIMELINE, sequence=step)
        strips = rr.LineStrips2D(lines, colors=_colours(shown), radii=0.5, draw_order=ABOVE)
        recording.log(f"{entity}/path", strips)
    _log_ends(recording, entity, paths[-1, :, POINTS // 2], shown, MARK_RADIUS)


def _log_z_theta(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Log the z_theta at each step, with the trail of all steps."""
    z = on_map(shown.z, len(shown.truth))  # (repair, step, 2)
    names = [str(start) for start in shown.start]
    log_static(recording, f"{entity}/trail", rr.LineStrips2D(z, colors=_colours(shown), radii=0.15))
    for step, points in enumerate(z.swapaxes(0, 1)):
        recording.set_time(TIMELINE, sequence=step)
        recording.log(f"{entity}/z_theta", rr.Points2D(points, colors=_colours(shown), labels=names, radii=0.7))
    _log_ends(recording, entity, z[:, -1], shown, MAP_MARK_RADIUS)


def _log_ends(recording: rr.RecordingStream, entity: str, ends: Array, shown: Repairs, radius: float) -> None:
    """Log at the last step which ends are truly valid; on the table, invalid ones are labelled."""
    recording.set_time(TIMELINE, sequence=shown.z.shape[1] - 1)
    for valid, name in ((True, "ends_valid"), (False, "ends_invalid")):
        chosen = shown.ends_valid == valid
        label = "still invalid" if not valid and radius == MARK_RADIUS else None
        if chosen.any():
            recording.log(f"{entity}/{name}", mark(ends[chosen], valid, radius, label))
    recording.reset_time()


def _log_series(recording: rr.RecordingStream, entity: str, shown: Repairs, values: Array) -> None:
    """Log a value (repair, step) of every repair over its steps."""
    names, steps = [f"start {start}" for start in shown.start], shown.z.shape[1]
    log_static(recording, entity, rr.SeriesLines(names=names, colors=_colours(shown), widths=2))
    scalars = rr.Scalars.columns(scalars=values.T.astype(np.float64).ravel())
    recording.send_columns(entity, [_steps(steps)], scalars.partition([len(names)] * steps))


def _steps(count: int) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, sequence=np.arange(count))


def _colours(shown: Repairs) -> list[tuple[int, int, int]]:
    return [COLOURS[i % len(COLOURS)] for i in range(len(shown.start))]
