"""Log new scenes and the model's gradient repairs, on the time line `repair_step`: one step per gradient step.

table/scene_000/{image,outlines,names}            the scene: see `scene.log_table`
table/scene_000/{starts,paths,valid,invalid}      the paths; marks at the ends that are valid or not
predicted/scene_000/{map,z_theta}                 the model's P(valid) over z_theta; the z_theta of the repairs
predicted/scene_000/lines                         the boundary of the truth; the trail of each repair
outcomes/scene_000/map                            the model's verdicts against the truth (`Repairs.outcomes`)
p_valid/scene_000, slack/scene_000                the model's P(valid); true clearance beyond the user's margins [cm]
"""

import numpy as np
import rerun as rr
from numpy import ndarray as Array

from pipeline.viewer.contents import Repairs, Run
from pipeline.viewer.demonstrations import ABOVE, POINTS, mark
from pipeline.viewer.geometry import boundary, on_map, on_table
from pipeline.viewer.scene import (
    BOUNDARY,
    MAPS,
    OUTCOME,
    START,
    log_map,
    log_static,
    log_table,
    p_classes,
    panel,
    scene_name,
)
from pipeline.world.bezier import curve

TIMELINE = "repair_step"
COLOURS = ((255, 255, 255), (190, 150, 255), (80, 220, 190), (255, 160, 190))  # of repairs, the same in all views


def log_repairs(recording: rr.RecordingStream, run: Run) -> None:
    """Log every new scene with its maps and all repairs."""
    for name, place in MAPS.items():
        log_static(recording, name, panel(place, len(run.repairs[0].truth)))
    for shown in run.repairs:
        scene = scene_name(shown.scene)
        log_table(recording, f"table/{scene}", shown.image, shown.layout, run.margins)
        log_map(recording, f"predicted/{scene}", p_classes(shown.predicted))
        _log_lines(recording, f"predicted/{scene}", shown)
        log_map(recording, f"outcomes/{scene}", OUTCOME + shown.outcomes)
        if shown.start:
            _log_paths(recording, f"table/{scene}", shown)
            _log_z_theta(recording, f"predicted/{scene}", shown)
            _log_series(recording, f"p_valid/{scene}", shown, shown.p)
            _log_series(recording, f"slack/{scene}", shown, 100 * shown.slack)


def _log_paths(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Log the paths at each step, and at the last which ends are truly valid; the invalid starts stay visible."""
    paths = on_table(curve(shown.z, POINTS)).swapaxes(0, 1)  # (step, repair, POINTS, 2)
    log_static(recording, f"{entity}/starts", rr.LineStrips2D(paths[0], colors=START, radii=0.2))
    for step, lines in enumerate(paths):
        recording.set_time(TIMELINE, sequence=step)
        strips = rr.LineStrips2D(lines, colors=_colours(shown), radii=0.5, draw_order=ABOVE)
        recording.log(f"{entity}/paths", strips)
    for valid, name in ((True, "valid"), (False, "invalid")):
        chosen = shown.ends_valid == valid
        if chosen.any():
            centres = paths[-1, chosen, POINTS // 2]
            recording.log(f"{entity}/{name}", mark(centres, valid, None if valid else "still invalid"))
    recording.reset_time()


def _log_lines(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Log the boundary of the truth and the z_theta of each repair at all its steps."""
    edges, trails = boundary(shown.truth), on_map(shown.z, len(shown.truth))
    colours = [*len(edges) * [BOUNDARY], *_colours(shown)]
    log_static(recording, f"{entity}/lines", rr.LineStrips2D([*edges, *trails], colors=colours, radii=0.15))


def _log_z_theta(recording: rr.RecordingStream, entity: str, shown: Repairs) -> None:
    """Log the z_theta at each step."""
    z = on_map(shown.z, len(shown.truth))  # (repair, step, 2)
    names = [str(start) for start in shown.start]
    for step, points in enumerate(z.swapaxes(0, 1)):
        recording.set_time(TIMELINE, sequence=step)
        recording.log(f"{entity}/z_theta", rr.Points2D(points, colors=_colours(shown), labels=names, radii=0.7))
    recording.reset_time()


def _log_series(recording: rr.RecordingStream, entity: str, shown: Repairs, values: Array) -> None:
    """Log a value (repair, step) of every repair over its steps."""
    names, steps = [f"start {start}" for start in shown.start], shown.z.shape[1]
    log_static(recording, entity, rr.SeriesLines(names=names, colors=_colours(shown), widths=2))
    scalars = rr.Scalars.columns(scalars=values.T.astype(np.float64).ravel())
    recording.send_columns(
        entity, [rr.TimeColumn(TIMELINE, sequence=np.arange(steps))], scalars.partition([len(names)] * steps)
    )


def _colours(shown: Repairs) -> list[tuple[int, int, int]]:
    return [COLOURS[i % len(COLOURS)] for i in range(len(shown.start))]
