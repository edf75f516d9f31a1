"""Write a Rerun recording of a folder: a tab for each user, a step for each scene.

user_1/table/{image,outlines,demonstrations,repairs}   the picture as the model sees it, detected objects, paths
user_1/map/map                                         P(valid) over control points, by a model new to the scene
user_1/titles                                          titles with the scene's name
"""

from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

from pipeline.own.fitting import Fitted
from pipeline.own.results import Results
from pipeline.viewer import scene as views
from pipeline.viewer.scene import AROUND, BACKDROP, PITCH, TABLE_PIXELS, beside_text, on_table
from pipeline.world.bezier import curve, lattice

TIMELINE, MAP_SIDE, POINTS = "scene", 40, 33
ABOUT = """Step through the scenes on the time line.
Left: the picture as the model sees it; white outlines are detected objects. Blue paths are valid by the user’s word,
vermilion ones invalid; yellow paths are the repairs of these. Right: P(valid) over control points, dark 0 to
light 1, by the model that was not fitted to this scene; the square is the table's edge.
"""


def write_recording(path: Path, results: Results) -> None:
    """Write the recording with its blueprint."""
    entities = {user: f"user_{number}" for number, user in enumerate(results.fitted, 1)}
    sides = (-AROUND, PITCH + TABLE_PIXELS + AROUND), (-4 * AROUND, TABLE_PIXELS + 2 * AROUND)
    shown = {"background": BACKDROP, "visual_bounds": rrb.VisualBounds2D(x_range=sides[0], y_range=sides[1])}
    tabs = [
        beside_text(user, rrb.Spatial2DView(origin="/", contents=[f"/{entity}/**"], titlebar=False, **shown), "own")
        for user, entity in entities.items()
    ]
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused", fps=0.5)
    hidden = rrb.BlueprintPanel(state="hidden"), rrb.SelectionPanel(state="hidden")
    blueprint = rrb.Blueprint(rrb.Tabs(*tabs, active_tab=0), *hidden, time, auto_views=False)
    with views.recording_at(path, "own-table", blueprint) as recording:
        views.log_static(recording, "text/own", views.markdown(ABOUT))
        for user, entity in entities.items():
            views.log_table_edges(recording, entity, [(0, 1)])
            views.log_static(recording, f"{entity}/map", views.panel((0, 1), MAP_SIDE))
            for step in range(len(results.folder.scenes)):
                recording.set_time(TIMELINE, sequence=step)
                _log_scene(recording, entity, results, results.fitted[user], step)


def _log_scene(recording: rr.RecordingStream, entity: str, results: Results, fitted: Fitted, scene: int) -> None:
    """Log one scene of one user."""
    name, image, data = results.folder.scenes[scene], results.folder.images[scene], fitted.data

    def lines(part: str, points: list, colours: Any, width: float) -> None:
        recording.log(f"{entity}/table/{part}", rr.LineStrips2D(points, colors=colours, radii=width))

    def paths(table: str, ends: list[str]) -> tuple[list, list]:
        rows = results.tables[table]
        rows = rows[(rows["user"] == data.user) & (rows["scene"] == name)].dropna(subset=ends)
        return list(on_table(curve(rows[ends].to_numpy(float), POINTS))), list(rows.get("valid", []))

    views.log_titles(recording, entity, {(0, 0): name, (0, 1): "P(valid)"})
    recording.log(f"{entity}/table/image", views.jpeg(image))
    lines("outlines", [on_table(points) for points in results.folder.outlines(scene)], views.ITEM, 0.2)
    points, words = paths("demonstrations", ["z_x", "z_y"])
    lines("demonstrations", points, [views.VALID if word else views.INVALID for word in words], 0.35)
    lines("repairs", paths("repaired", ["end_x", "end_y"])[0], views.START, 0.2)
    model = fitted.unseeing(data.scenes.index(name)) if name in data.scenes else fitted.model
    p = model.probability(results.folder.seen.objects[[scene]], lattice(MAP_SIDE)[None])[0].reshape(MAP_SIDE, MAP_SIDE)
    views.log_map(recording, f"{entity}/map", views.p_classes(p))
