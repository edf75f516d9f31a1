"""Write the overview: all variants and the truth in the same new scenes, as one Rerun file.

Entities (coordinates: see `geometry`):

    about, text/overview               sources of the recording; explanation
    fixed/table_edges                  the table's edge in every map
    USER/table/{image,outlines,names}  a scene with items never seen in training
    USER/truth/map                     which z_theta are valid
    USER/VARIANT/map                   the model's verdicts against the truth (`Repairs.outcomes`)
    USER/titles                        the panels' titles, with the share of right verdicts

A user's entities are on the time line `scene`, one step per scene, the one with most wrong verdicts first.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from pipeline.legend import label
from pipeline.viewer.blueprint import layout_of_overview
from pipeline.viewer.contents import Run, grouped
from pipeline.viewer.scene import (
    OUTCOME,
    log_map,
    log_table,
    log_table_edges,
    log_texts,
    log_titles,
    panel,
    recording_at,
)
from pipeline.viewer.texts import text

TIMELINE, COLUMNS = "scene", 4  # columns of the board


def write_overview(path: Path, runs: Sequence[Run]) -> None:
    """Write `runs` of the same scenes, one per user and variant, to `path` with a blueprint."""
    users = grouped(runs, "user")
    count = 2 + max(map(len, users.values()))  # table, truth, variants
    places = [divmod(i, COLUMNS) for i in range(count)]
    layout = layout_of_overview(runs, TIMELINE, (places[-1][0] + 1, min(count, COLUMNS)))
    with recording_at(path, "overview", layout) as recording:
        log_texts(recording, text("about_overview", runs), {"overview": text("overview", runs)})
        log_table_edges(recording, "fixed", places[1:])
        for of_user in users.values():
            agreement = np.mean([[shown.agreement for shown in run.repairs] for run in of_user], axis=0)
            worst_first = np.argsort(agreement, kind="stable").tolist()
            for step, scene in enumerate(worst_first):
                recording.set_time(TIMELINE, sequence=step)
                _log_scene(recording, of_user, scene, places)


def _log_scene(
    recording: rr.RecordingStream, runs: Sequence[Run], scene: int, places: Sequence[tuple[int, int]]
) -> None:
    """Log one user's table, the truth and every model's verdicts in one scene."""
    user, shown = runs[0].user, [run.repairs[scene] for run in runs]
    titles = [f"New scene {shown[0].scene}", "Truth"]
    titles += [f"{label(run.variant)}: {of_run.agreement:.0%} right" for run, of_run in zip(runs, shown, strict=True)]
    log_titles(recording, user, dict(zip(places, titles, strict=True)))
    log_table(recording, f"{user}/table", shown[0].image, shown[0].layout, runs[0].margins)
    maps = {"truth": shown[0].truth, **{run.variant: of_run.outcomes for run, of_run in zip(runs, shown, strict=True)}}
    for place, (name, values) in zip(places[1:], maps.items(), strict=True):
        log_map(recording, f"{user}/{name}", OUTCOME + values.astype(np.uint8), panel(place, len(values)))
