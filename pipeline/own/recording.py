"""Write a Rerun recording of a folder: a tab for each user, a step for each scene.

user_1/table/{image,outlines,demonstrations,repairs}   the picture as the model sees it, items, paths
user_1/titles                                          a title with the scene's name
"""

from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from pipeline.own.fitting import Fitted
from pipeline.own.results import Results
from pipeline.viewer import scene as views
from pipeline.viewer.scene import on_table
from pipeline.world.bezier import bezier

TIMELINE, POINTS = "scene", 33
ABOUT = """Step through the scenes on the time line.
The picture is shown as the model sees it; white outlines are items. Blue paths are valid by the user’s word, vermilion
ones invalid; yellow paths are the repairs of these, by the model that was not fitted to this scene.
"""


def write_recording(path: Path, results: Results) -> None:
    """Write the recording with its blueprint."""
    entities = {user: f"user_{number}" for number, user in enumerate(results.fitted, 1)}
    tabs = [views.beside_text(user, views.board((1, 1), f"/{entity}/**"), "own") for user, entity in entities.items()]
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused", fps=0.5)
    with views.recording_at(path, "own-table", views.tabbed("own-table", tabs, time)) as recording:
        views.log_texts(recording, ABOUT, {"own": ABOUT})
        for user, entity in entities.items():
            for step in range(len(results.folder.scenes)):
                recording.set_time(TIMELINE, sequence=step)
                _log_scene(recording, entity, results, results.fitted[user], step)


def _log_scene(recording: rr.RecordingStream, entity: str, results: Results, fitted: Fitted, scene: int) -> None:
    """Log one scene of one user."""
    name, image, data = results.folder.scenes[scene], results.folder.images[scene], fitted.data

    def lines(part: str, points: list, colours: Any, width: float) -> None:
        recording.log(f"{entity}/table/{part}", rr.LineStrips2D(points, colors=colours, radii=width))

    views.log_titles(recording, entity, {(0, 0): name})
    recording.log(f"{entity}/table/image", views.jpeg(image))
    lines("outlines", [on_table(points) for points in results.folder.outlines(scene)], views.ITEM, 0.2)
    demos = results.folder.demos
    shown = demos[(demos["user"] == data.user) & (demos["scene"] == name)]
    points = list(on_table(bezier(results.folder.controls(shown), POINTS)))
    lines("demonstrations", points, [views.VALID if word else views.INVALID for word in shown["valid"]], 0.35)
    ends = results.repaired_paths(data.user, name).values()
    lines("repairs", [on_table(results.folder.frame.to_model(path)) for path in ends], views.START, 0.2)
