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
import rerun.blueprint as rrb

from pipeline.legend import label
from pipeline.viewer.blueprint import beside_text, board, tabbed
from pipeline.viewer.contents import Run, grouped
from pipeline.viewer.run import text
from pipeline.viewer.scene import (
    OUTCOME,
    log_map,
    log_table,
    log_table_edges,
    log_texts,
    log_titles,
    panel,
    recording_at,
)  # fmt: skip

TIMELINE, COLUMNS = "scene", 4  # columns of the board


def write_overview(path: Path, runs: Sequence[Run]) -> None:
    """Write `runs` of the same scenes, one per user and variant, to `path` with a blueprint: a tab per user."""
    users = grouped(runs, "user")
    count = 2 + max(map(len, users.values()))  # table, truth, variants
    places = [divmod(i, COLUMNS) for i in range(count)]
    shape = places[-1][0] + 1, min(count, COLUMNS)
    tabs = [
        beside_text(f"{user} user", board(shape, f"/{user}/**", "/fixed/table_edges"), "overview") for user in users
    ]
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused", fps=0.5)
    with recording_at(path, "overview", tabbed("overview", tabs, time)) as recording:
        log_texts(recording, text("about_overview", runs), {"overview": text("overview", runs)})
        log_table_edges(recording, "fixed", places[1:])
        for user, of_user in users.items():
            agreement = np.mean([[shown.agreement for shown in run.repairs] for run in of_user], axis=0)
            for step, scene in enumerate(np.argsort(agreement, kind="stable").tolist()):  # the worst first
                recording.set_time(TIMELINE, sequence=step)
                shown = {run.variant: run.repairs[scene] for run in of_user}
                first = next(iter(shown.values()))
                titles = [f"New scene {first.scene}", "Truth"]
                titles += [f"{label(variant)}: {of_run.agreement:.0%} right" for variant, of_run in shown.items()]
                log_titles(recording, user, dict(zip(places, titles, strict=True)))
                log_table(recording, f"{user}/table", first.image, first.layout, of_user[0].margins)
                maps = {"truth": first.truth, **{variant: of_run.outcomes for variant, of_run in shown.items()}}
                for place, (name, values) in zip(places[1:], maps.items(), strict=True):
                    classes = OUTCOME + values.astype(np.uint8)
                    log_map(recording, f"{user}/{name}", classes, panel(place, len(values)))
