"""Training scenes with the user's demonstrations in them.

training/scene_000/{image,items,kept_clear}                  a training scene
training/scene_000/{valid,invalid}/{recorded,fitted,marks}   the demonstrations
"""

import numpy as np
import rerun as rr
from numpy import ndarray as Array

from pipeline.viewer.contents import Demonstrations, Run
from pipeline.viewer.geometry import TABLE_PIXELS, crosses, on_table
from pipeline.viewer.scene import INVALID, VALID, log_static, log_table, log_titles, panel
from pipeline.world.bezier import curve

POINTS = 13  # points drawn along a Bezier path
ABOVE, TOP = 40.0, 50.0  # draw orders of moving paths and of marks; Rerun's own end at 30 (points)
MARK_RADIUS = 1.5  # radius of a mark on the table [px]
RECORDED = (10, 10, 10)  # colour (RGB) of recorded trajectories


def log_demonstrations(recording: rr.RecordingStream, run: Run) -> None:
    """Log each training scene in its own column."""
    titles = {(0, i): f"Training scene {shown.scene}" for i, shown in enumerate(run.demonstrations)}
    log_titles(recording, "training", titles)
    for column, shown in enumerate(run.demonstrations):
        entity = f"training/scene_{shown.scene:03d}"
        log_static(recording, entity, panel((0, column), TABLE_PIXELS))
        log_table(recording, entity, shown.image, shown.layout, run.margins)
        _log_paths(recording, entity, shown)


def _log_paths(recording: rr.RecordingStream, entity: str, shown: Demonstrations) -> None:
    """Log valid paths thick with a disc, invalid ones thin with a cross."""
    for valid, colour, radius in ((True, VALID, 0.45), (False, INVALID, 0.2)):
        chosen = np.flatnonzero(shown.valid == valid)
        if len(chosen) == 0:
            continue
        under = f"{entity}/{'valid' if valid else 'invalid'}"
        recorded = [on_table(shown.samples[i][:, 1:3]) for i in chosen]
        fitted = on_table(curve(shown.z[chosen], POINTS))
        lines = rr.LineStrips2D(recorded, colors=RECORDED, radii=0.08, draw_order=ABOVE)
        log_static(recording, f"{under}/recorded", lines)
        log_static(recording, f"{under}/fitted", rr.LineStrips2D(fitted, colors=colour, radii=radius))
        log_static(recording, f"{under}/marks", mark(fitted[:, POINTS // 2], valid, MARK_RADIUS))


def mark(centres: Array, valid: bool, radius: float, label: str | None = None) -> rr.AsComponents:
    """Return a disc for each valid path and a cross for each invalid one, with a label."""
    labels = None if label is None else [label] * len(centres)
    if valid:
        return rr.Points2D(centres, colors=VALID, radii=radius, draw_order=TOP, labels=labels)
    return rr.LineStrips2D(crosses(centres, radius), colors=INVALID, radii=0.3 * radius, draw_order=TOP, labels=labels)
