"""Write the overview: all variants and the truth in the same new scenes, as one Rerun file.

Entities (coordinates: see `geometry`):

    about, text/overview                    sources of the recording; explanation
    fixed/{ends,table_edge}                 start and goal on the table; the table in a map
    USER/table/{image,items,kept_clear}     a scene with items never seen in training
    USER/{truth,predicted/VARIANT}/map      P(valid) over z_theta: the user's, the model's
    USER/errors/VARIANT/map                 cells on which model and user disagree (`Repairs.errors`)
    USER/truth/boundary                     the boundary of the truth

A user's entities are on the time line `scene`, one step per scene.
"""

from collections.abc import Sequence
from pathlib import Path

import rerun as rr

from pipeline.viewer.blueprint import layout_of_overview
from pipeline.viewer.contents import FALSELY_INVALID, FALSELY_VALID, RIGHT, Run, by_user
from pipeline.viewer.geometry import map_image
from pipeline.viewer.scene import (
    INVALID,
    SAME,
    VALID,
    log_boundary,
    log_ends,
    log_map,
    log_static,
    log_table,
    log_table_edge,
    log_texts,
    recording_at,
    table_edge,
)
from pipeline.viewer.texts import about_overview, overview_text

TIMELINE = "scene"

# An error has the colour of the truth.
CLASSES = (
    (RIGHT, "right", SAME),
    (FALSELY_VALID, "invalid, called valid", INVALID),
    (FALSELY_INVALID, "valid, called invalid", VALID),
)


def write_overview(path: Path, runs: Sequence[Run]) -> None:
    """Write `runs` of the same scenes, one per user and variant, to `path` with a blueprint."""
    with recording_at(path, "overview", layout_of_overview(runs, TIMELINE)) as recording:
        log_texts(recording, about_overview(runs), {"overview": overview_text(runs)})
        log_ends(recording)
        log_table_edge(recording, "fixed", table_edge(len(runs[0].repairs[0].truth))[None], 0.12)
        log_static(recording, "/", rr.AnnotationContext(CLASSES))
        for user, of_user in by_user(runs).items():
            for shown in of_user[0].repairs:
                recording.set_time(TIMELINE, sequence=shown.scene)
                log_table(recording, f"{user}/table", shown.image, shown.layout, of_user[0].margins)
                log_map(recording, f"{user}/truth", shown.truth)
                log_boundary(recording, f"{user}/truth", shown.truth)
            for run in of_user:
                _log_predictions(recording, run)


def _log_predictions(recording: rr.RecordingStream, run: Run) -> None:
    """Log one model's map and errors in every scene."""
    for shown in run.repairs:
        recording.set_time(TIMELINE, sequence=shown.scene)
        log_map(recording, f"{run.user}/predicted/{run.variant}", shown.predicted)
        errors = rr.SegmentationImage(map_image(shown.errors), opacity=1.0)
        recording.log(f"{run.user}/errors/{run.variant}/map", errors)
