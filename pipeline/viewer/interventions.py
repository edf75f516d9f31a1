"""What one item more changes: the table, the maps and the effects, on the time line `intervention` a step a symbol."""

import numpy as np
import rerun as rr

from pipeline.viewer.board import log_titles, panel
from pipeline.viewer.contents import Run
from pipeline.viewer.geometry import TABLE_PIXELS, changed, footprints, on_table
from pipeline.viewer.readme import intervention_words
from pipeline.viewer.scene import (
    CHOSEN,
    HALF,
    log_boundary,
    log_difference,
    log_map,
    picture,
    set_time,
    words,
)

TIMELINE, ENTITY = "intervention", "interventions"

# Below row 0, the scene as it is, which is logged with its repairs.
TABLE = (1, 0)
MAPS = {"predicted": (1, 1), "truth": (1, 2), "learned_effect": (2, 1), "true_effect": (2, 2)}
TITLES = {
    TABLE: "An item more",
    (1, 1): "Model, after",
    (1, 2): "Truth, after",
    (2, 1): "Learned effect: after - before",
    (2, 2): "True effect: after - before",
}


def log_interventions(recording: rr.RecordingStream, run: Run) -> None:
    """Every intervention on the first of the run's new scenes"""
    before = run.repairs[0]
    places = {name: panel(at, len(before.truth)) for name, at in MAPS.items()}
    recording.log(f"{ENTITY}/table", panel(TABLE, TABLE_PIXELS), static=True)
    recording.log(f"{ENTITY}/predicted", places["predicted"], static=True)
    log_titles(recording, ENTITY, TITLES, list(MAPS.values()))
    recording.log(f"{ENTITY}/table/image", picture(before.image))
    for step, done in enumerate(run.interventions):
        set_time(recording, TIMELINE, step)
        _, outline = footprints(done.layout)[-1]
        recording.log(f"{ENTITY}/table/changed", picture(changed(before.image, done.image)))
        recording.log(f"{ENTITY}/table/added", rr.LineStrips2D([on_table(outline)], colors=CHOSEN, radii=0.5))
        log_map(recording, f"{ENTITY}/predicted", done.predicted, precision=HALF)
        log_map(recording, f"{ENTITY}/truth", done.truth, places["truth"], precision=HALF)
        log_boundary(recording, f"{ENTITY}/predicted", done.truth)
        log_difference(
            recording, f"{ENTITY}/learned_effect", done.predicted - before.predicted, places["learned_effect"]
        )
        change = done.truth - before.truth.astype(np.float64)
        log_difference(recording, f"{ENTITY}/true_effect", change, places["true_effect"])
        recording.log(f"{ENTITY}/words", words(intervention_words(run, step)))
        recording.reset_time()
