"""Training scenes with the user's demonstrations in them.

training/scene_000/{image,outlines,names}     a training scene: see `scene.log_table`
training/scene_000/{paths,valid,invalid}      the demonstrations, as recorded and as fitted; a mark on each
"""

import numpy as np
import rerun as rr
from numpy import ndarray as Array

from pipeline.viewer.contents import Demonstrations, Run
from pipeline.viewer.geometry import TABLE_PIXELS, crosses, on_table
from pipeline.viewer.scene import INVALID, VALID, log_static, log_table, log_titles, panel, scene_name
from pipeline.world.bezier import curve

POINTS = 13  # points drawn along a Bezier path
EVERY = 5  # of a recorded trajectory's samples, each fifth is drawn
ABOVE, TOP = 40.0, 50.0  # draw orders of moving paths and of marks; Rerun's own end at 30 (points)
MARK_RADIUS = 1.5  # radius of a mark on the table [px]
RECORDED = (10, 10, 10)  # colour (RGB) of recorded trajectories


def log_demonstrations(recording: rr.RecordingStream, run: Run) -> None:
    """Log each training scene in its own column: valid paths thick with a disc, invalid ones thin with a cross."""
    titles = {(0, i): f"Training scene {shown.scene}" for i, shown in enumerate(run.demonstrations)}
    log_titles(recording, "training", titles)
    for column, shown in enumerate(run.demonstrations):
        entity = f"training/{scene_name(shown.scene)}"
        log_static(recording, entity, panel((0, column), TABLE_PIXELS))
        log_table(recording, entity, shown.image, shown.layout, run.margins)
        _log_paths(recording, entity, shown)


def _log_paths(recording: rr.RecordingStream, entity: str, shown: Demonstrations) -> None:
    """Log the fitted paths, below the trajectories they were fitted to."""
    fitted = on_table(curve(shown.z, POINTS))
    recorded = [on_table(samples[::EVERY, 1:3]) for samples in shown.samples]
    colours = [*(VALID if valid else INVALID for valid in shown.valid), *len(recorded) * [RECORDED]]
    radii = [*np.where(shown.valid, 0.5, 0.25).tolist(), *len(recorded) * [0.08]]
    log_static(recording, f"{entity}/paths", rr.LineStrips2D([*fitted, *recorded], colors=colours, radii=radii))
    for valid, name in ((True, "valid"), (False, "invalid")):
        if (shown.valid == valid).any():
            log_static(recording, f"{entity}/{name}", mark(fitted[shown.valid == valid, POINTS // 2], valid))


def mark(centres: Array, valid: bool, label: str | None = None) -> rr.AsComponents:
    """Return a disc for each valid path and a cross for each invalid one, with a label."""
    labels = None if label is None else [label] * len(centres)
    if valid:
        return rr.Points2D(centres, colors=VALID, radii=MARK_RADIUS, draw_order=TOP, labels=labels)
    return rr.LineStrips2D(
        crosses(centres, MARK_RADIUS), colors=INVALID, radii=0.3 * MARK_RADIUS, draw_order=TOP, labels=labels
    )
