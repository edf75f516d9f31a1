"""Write one model's recording as a Rerun file.

Entities (coordinates: see `geometry`):

    about, text/{repairs,interventions,learning,training}    sources of the recording; explanation of each tab
    fixed/{titles,table_edges}                               titles and edges of a new scene's panels
    {table,predicted,outcomes,p_valid,slack}/scene_000/...   see `repairs`; on the time line `repair_step`
    {predicted,outcomes}/learning/map, losses                see `learning`
    interventions/...                                        see `interventions`
    training/scene_000/...                                   see `demonstrations`
"""

from pathlib import Path

from pipeline.viewer.blueprint import layout_of
from pipeline.viewer.contents import Run
from pipeline.viewer.demonstrations import log_demonstrations
from pipeline.viewer.interventions import log_interventions
from pipeline.viewer.learning import log_learning
from pipeline.viewer.repairs import TIMELINE, log_repairs
from pipeline.viewer.scene import MAPS, TITLES, log_table_edges, log_texts, log_titles, recording_at
from pipeline.viewer.texts import text


def write_run(path: Path, run: Run) -> None:
    """Write `run`, which has at least one new scene, to `path` with its blueprint."""
    with recording_at(path, run.name, layout_of(run, TIMELINE)) as recording:
        tabs = ("repairs", "interventions", "learning", "training")
        log_texts(recording, text("about_run", run), {tab: text(tab, run) for tab in tabs})
        log_titles(recording, "fixed", TITLES)
        log_table_edges(recording, "fixed", MAPS.values())
        log_repairs(recording, run)
        log_interventions(recording, run)
        log_learning(recording, run)
        log_demonstrations(recording, run)
