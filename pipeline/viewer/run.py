"""Write one model's recording as a Rerun file.

Entities (coordinates: see `geometry`):

    about, text/{repairs,interventions,learning,training}   sources of the recording; explanation of each tab
    fixed/{ends,titles,table_edge}                     start and goal on the table; the titles of a new scene's panels
    fixed/even_odds                                    p = 0.5, above which the model accepts a path
    training/scene_000/...                             see `demonstrations`
    new_items/scene_000/...                            see `repairs`; on the time line `repair_step`
    new_items/scene_000/latent/{predicted,difference}/learning/map, losses   see `learning`
    interventions/...                                  see `interventions`
"""

from pathlib import Path

import rerun as rr

from pipeline.viewer import texts
from pipeline.viewer.blueprint import layout_of
from pipeline.viewer.contents import Run
from pipeline.viewer.demonstrations import log_demonstrations
from pipeline.viewer.interventions import log_interventions
from pipeline.viewer.learning import log_learning
from pipeline.viewer.repairs import TIMELINE, log_repairs
from pipeline.viewer.scene import (
    DIFFERENCES,
    SCENE_MAPS,
    SCENE_TITLES,
    log_ends,
    log_static,
    log_texts,
    log_titles,
    recording_at,
)


def write_run(path: Path, run: Run) -> None:
    """Write `run`, which has at least one new scene, to `path` with its blueprint."""
    with recording_at(path, run.name, layout_of(run, TIMELINE)) as recording:
        by_tab = {
            "repairs": texts.repairs_text(run),
            "interventions": texts.interventions_text(run),
            "learning": texts.learning_text(run),
            "training": texts.demonstrations_text(),
        }
        log_texts(recording, texts.about_run(run), by_tab)
        log_ends(recording)
        log_titles(recording, "fixed", SCENE_TITLES, list(SCENE_MAPS.values()))
        log_static(recording, "/", rr.AnnotationContext(DIFFERENCES))
        log_demonstrations(recording, run)
        log_repairs(recording, run)
        log_interventions(recording, run)
        log_learning(recording, run)
