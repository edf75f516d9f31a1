"""Write a Rerun recording of a folder: a tab for each user, a step for each scene.

user_1/table/{image,outlines,demonstrations,repairs}   the picture as the model sees it, detected objects, paths
user_1/map/map                                         P(valid) over control points, by a model new to the scene
user_1/titles                                          titles with the scene's name

A scene without demonstrations shows the model of all scenes.
"""

from pathlib import Path

import rerun as rr
import rerun.blueprint as rrb

from pipeline.own.fitting import Fitted
from pipeline.own.results import Results
from pipeline.viewer.blueprint import BACKDROP, beside_text
from pipeline.viewer.geometry import PITCH, TABLE_PIXELS, on_table
from pipeline.viewer.scene import (
    INVALID,
    ITEM,
    START,
    VALID,
    jpeg,
    log_map,
    log_static,
    log_table_edges,
    log_titles,
    markdown,
    p_classes,
    panel,
    recording_at,
)
from pipeline.world.bezier import curve, lattice

TIMELINE, MAP_SIDE, POINTS, AROUND = "scene", 40, 33, 4.0
ABOUT = """Step through the scenes on the time line.
Left: the picture as the model sees it; white outlines are detected objects. Blue paths are valid by the user’s word,
vermilion ones invalid; yellow paths are the repairs of these. Right: P(valid) over control points, dark 0 to
light 1, by the model that was not fitted to this scene; the square is the table's edge.
"""


def write_recording(path: Path, results: Results) -> None:
    """Write the recording with its blueprint."""
    entities = {user: f"user_{number}" for number, user in enumerate(results.fitted, 1)}
    bounds = rrb.VisualBounds2D(
        x_range=(-AROUND, PITCH + TABLE_PIXELS + AROUND), y_range=(-4 * AROUND, TABLE_PIXELS + 2 * AROUND)
    )
    boards = {
        user: rrb.Spatial2DView(
            origin="/", contents=[f"/{entity}/**"], background=BACKDROP, visual_bounds=bounds, titlebar=False
        )
        for user, entity in entities.items()
    }
    tabs = rrb.Tabs(*(beside_text(user, board, "own") for user, board in boards.items()), active_tab=0)
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused", fps=0.5)
    hidden = rrb.BlueprintPanel(state="hidden"), rrb.SelectionPanel(state="hidden")
    with recording_at(path, "own-table", rrb.Blueprint(tabs, *hidden, time, auto_views=False)) as recording:
        log_static(recording, "text/own", markdown(ABOUT))
        for user, entity in entities.items():
            log_table_edges(recording, entity, [(0, 1)])
            log_static(recording, f"{entity}/map", panel((0, 1), MAP_SIDE))
            for step in range(len(results.scenes.names)):
                recording.set_time(TIMELINE, sequence=step)
                _log_scene(recording, entity, results, results.fitted[user], step)


def _log_scene(recording: rr.RecordingStream, entity: str, results: Results, fitted: Fitted, scene: int) -> None:
    """Log one scene of one user."""
    name, image = results.scenes.names[scene], results.scenes.images[scene]
    data = fitted.data
    log_titles(recording, entity, {(0, 0): name, (0, 1): "P(valid)"})
    recording.log(f"{entity}/table/image", jpeg(image))
    outlines = [on_table(points) for points in results.scenes.outlines(scene)]
    recording.log(f"{entity}/table/outlines", rr.LineStrips2D(outlines, colors=ITEM, radii=0.2))
    rows = results.tables["demonstrations"].query("user == @data.user and scene == @name")
    paths = on_table(curve(rows[["z_x", "z_y"]].to_numpy(float), POINTS))
    colours = [VALID if word else INVALID for word in rows["valid"]]
    recording.log(f"{entity}/table/demonstrations", rr.LineStrips2D(paths, colors=colours, radii=0.35))
    rows = results.tables["repaired"].query("user == @data.user and scene == @name").dropna()
    ends = on_table(curve(rows[["end_x", "end_y"]].to_numpy(float), POINTS))
    recording.log(f"{entity}/table/repairs", rr.LineStrips2D(ends, colors=START, radii=0.2))
    model = fitted.unseeing(data.scenes.index(name)) if name in data.scenes else fitted.model
    p = model.probability(image[None], lattice(MAP_SIDE)[None])[0].reshape(MAP_SIDE, MAP_SIDE)
    log_map(recording, f"{entity}/map", p_classes(p))
