"""Log the effect of added items on table, maps and E[V], on the time line `intervention`: one step per symbol."""

import numpy as np
import rerun as rr

from pipeline.viewer.contents import Run
from pipeline.viewer.geometry import TABLE_PIXELS, changed, footprints, on_table
from pipeline.viewer.scene import (
    ADDED,
    HALF,
    log_boundary,
    log_difference,
    log_map,
    log_static,
    log_titles,
    markdown,
    panel,
    png,
    set_time,
)
from pipeline.viewer.texts import intervention_effects

TIMELINE, ENTITY = "intervention", "interventions"

# Below row 0, the unchanged scene, which is logged with its repairs.
TABLE = (1, 0)  # panel (row, column) of the table
MAPS = {"predicted": (1, 1), "truth": (1, 2), "learned_effect": (2, 1), "true_effect": (2, 2)}  # panels of the maps
TITLES = {
    TABLE: "Item added",
    (1, 1): "Model, after",
    (1, 2): "Truth, after",
    (2, 1): "Model's effect: after - before",
    (2, 2): "True effect: after - before",
}


def log_interventions(recording: rr.RecordingStream, run: Run) -> None:
    """Log every intervention on the first new scene of the run."""
    before = run.repairs[0]
    places = {name: panel(place, len(before.truth)) for name, place in MAPS.items()}
    log_static(recording, f"{ENTITY}/table", panel(TABLE, TABLE_PIXELS))
    log_static(recording, f"{ENTITY}/predicted", places["predicted"])
    log_titles(recording, ENTITY, TITLES, list(MAPS.values()))
    recording.log(f"{ENTITY}/table/image", png(before.image))
    for step, done in enumerate(run.interventions):
        set_time(recording, TIMELINE, step)
        _, outline = footprints(done.layout)[-1]
        recording.log(f"{ENTITY}/table/changed", png(changed(before.image, done.image)))
        recording.log(f"{ENTITY}/table/added", rr.LineStrips2D([on_table(outline)], colors=ADDED, radii=0.5))
        log_map(recording, f"{ENTITY}/predicted", done.predicted, precision=HALF)
        log_map(recording, f"{ENTITY}/truth", done.truth, places["truth"], precision=HALF)
        log_boundary(recording, f"{ENTITY}/predicted", done.truth)
        learned = done.predicted - before.predicted
        true = done.truth - before.truth.astype(np.float64)
        log_difference(recording, f"{ENTITY}/learned_effect", learned, places["learned_effect"])
        log_difference(recording, f"{ENTITY}/true_effect", true, places["true_effect"])
        recording.log(f"{ENTITY}/effects", markdown(intervention_effects(run, step)))
        recording.reset_time()
