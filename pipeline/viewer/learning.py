"""Log a model's training: its map by number of demonstrations and by training step, and its losses."""

from dataclasses import replace

import numpy as np
import rerun as rr

from pipeline.viewer.contents import Run
from pipeline.viewer.scene import OUTCOME, TIMELINES, log_map, log_static, p_classes

DEMONSTRATIONS, STEPS = "demonstrations", "train_step"
TERMS = ((240, 228, 66), (86, 220, 160), (204, 121, 167), (120, 160, 255))  # colours of the loss terms


def log_learning(recording: rr.RecordingStream, run: Run) -> None:
    """Log the map of the first new scene by number of demonstrations and by training step, and every loss."""
    learning = run.learning
    others = {timeline: first for timeline, first in TIMELINES.items() if timeline != STEPS}
    maps = [({**others, DEMONSTRATIONS: n}, predicted) for n, predicted in learning.by_n.items()]
    maps += [({STEPS: step}, predicted) for step, predicted in learning.by_step.items()]
    for times, predicted in maps:
        recording.reset_time()
        for timeline, time in times.items():
            recording.set_time(timeline, sequence=time)
        log_map(recording, "predicted/learning", p_classes(predicted))
        log_map(recording, "outcomes/learning", OUTCOME + replace(run.repairs[0], predicted=predicted).outcomes)
    recording.reset_time()
    terms = list(learning.losses)
    colours = [TERMS[i % len(TERMS)] for i in range(len(terms))]
    log_static(recording, "losses", rr.SeriesLines(names=terms, colors=colours, widths=1.5))
    losses = np.stack(list(learning.losses.values()), axis=-1).astype(np.float64)  # (step, term)
    rows = rr.Scalars.columns(scalars=losses.ravel()).partition([len(terms)] * len(losses))
    recording.send_columns("losses", [rr.TimeColumn(STEPS, sequence=learning.step)], rows)
