"""A rejected path as it stands and without each item, on the time line `counterfactual`, a step a question."""

import rerun as rr

from pipeline.viewer.contents import Counterfactual, Run
from pipeline.viewer.geometry import changed, footprints, on_table
from pipeline.viewer.readme import counterfactual_words
from pipeline.viewer.scene import CHOSEN, INVALID, ITEM, VALID, picture, set_time, words
from pipeline.world.bezier import curve

TIMELINE, ENTITY = "counterfactual", "counterfactuals"
POINTS = 17  # drawn along a path


def log_counterfactuals(recording: rr.RecordingStream, run: Run) -> None:
    """Every question of every worked example, and both answers to it."""
    step = 0
    for asked in run.counterfactuals:
        for question in range(len(asked.p)):
            set_time(recording, TIMELINE, step)
            _question(recording, asked, question)
            recording.log(f"{ENTITY}/words", words(counterfactual_words(run, asked, question)))
            step += 1
    recording.reset_time()


def _question(recording: rr.RecordingStream, asked: Counterfactual, question: int) -> None:
    """The table as it stands (question 0), then without each item; the path in the colour of the truth."""
    items = footprints(asked.layout)
    outlines = [on_table(outline) for _, outline in items]
    image = asked.image if question == 0 else asked.without[question - 1]
    if question == 0:
        names = [symbol for symbol, _ in items]
        recording.log(f"{ENTITY}/table/image", picture(asked.image))
        recording.log(f"{ENTITY}/table/items", rr.LineStrips2D(outlines, labels=names, colors=ITEM, radii=0.25))
    path, gone = on_table(curve(asked.z, POINTS)), outlines[question - 1 : question] if question else []
    colours = [VALID if asked.truth[question] else INVALID] + [CHOSEN] * len(gone)
    recording.log(f"{ENTITY}/table/changed", picture(changed(asked.image, image)))
    recording.log(f"{ENTITY}/table/path_and_gone", rr.LineStrips2D([path, *gone], colors=colours, radii=0.6))
