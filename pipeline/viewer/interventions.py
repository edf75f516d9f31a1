"""Log the effect of added items on table, maps and E[V], on the time line `intervention`: one step per symbol."""

import numpy as np
import rerun as rr

from pipeline.viewer.contents import Run
from pipeline.viewer.geometry import TABLE_PIXELS, footprints, on_table
from pipeline.viewer.scene import (
    START,
    effect_classes,
    jpeg,
    log_map,
    log_static,
    log_table_edges,
    log_titles,
    markdown,
    p_classes,
    panel,
    set_time,
)
from pipeline.viewer.texts import text

TIMELINE, ENTITY = "intervention", "interventions"

# The first panel is the unchanged scene, which is logged with its repairs.
TABLE = (1, 0)  # panel (row, column) of the table with the item
MAPS = {"predicted": (0, 1), "truth": (0, 2), "learned_effect": (1, 1), "true_effect": (1, 2)}  # panels of the maps
TITLES = {
    (0, 0): "Before",
    TABLE: "Item added",
    (0, 1): "Model's P(valid), after",
    (0, 2): "Truth, after",
    (1, 1): "Model's effect",
    (1, 2): "True effect",
}


def log_interventions(recording: rr.RecordingStream, run: Run) -> None:
    """Log every intervention on the first new scene of the run."""
    before = run.repairs[0]
    log_static(recording, f"{ENTITY}/table", panel(TABLE, TABLE_PIXELS))
    log_titles(recording, ENTITY, TITLES)
    log_table_edges(recording, ENTITY, MAPS.values())
    places = {name: panel(place, len(before.truth)) for name, place in MAPS.items()}
    for step, done in enumerate(run.interventions):
        set_time(recording, TIMELINE, step)
        _, outline = footprints(done.layout)[-1]
        recording.log(f"{ENTITY}/table/image", jpeg(done.image))
        recording.log(f"{ENTITY}/table/added", rr.LineStrips2D([on_table(outline)], colors=START, radii=0.5))
        maps = {
            "predicted": p_classes(done.predicted),
            "truth": p_classes(done.truth),
            "learned_effect": effect_classes(done.predicted - before.predicted),
            "true_effect": effect_classes(done.truth - before.truth.astype(np.float64)),
        }
        for name, values in maps.items():
            log_map(recording, f"{ENTITY}/{name}", values, places[name])
        recording.log(f"{ENTITY}/effects", markdown(text("effects", run, step)))
        recording.reset_time()
