"""Compare the overviews of two commits: where a model was right before and is wrong now."""

from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import UInt8
from numpy import ndarray as Array
from rerun.chunk import RrdReader

from pipeline.legend import label
from pipeline.runtime.errors import InputError
from pipeline.viewer import scene as views
from pipeline.viewer.contents import ACCEPTED, FALSELY_INVALID, FALSELY_VALID, REJECTED
from pipeline.viewer.run import COLUMNS, SCENE

Maps = dict[tuple[str, str, str], UInt8[Array, "side side"]]  # by user, variant and the title of the scene
TEXT = """One step a scene, the one with most *right before, wrong now* first. A panel for each model in both commits.

Light: right in both. Dark: wrong in both. **Orange: right before, wrong now. Blue: wrong before, right now.**"""
CLASSES = np.array([[REJECTED, FALSELY_INVALID], [FALSELY_VALID, ACCEPTED]])  # [right before, right now]


def read_overview(path: Path) -> Maps:
    """Return the models' outcome maps, as images of classes, in the overview at `path`."""
    titles, buffers = {}, {}
    for chunk in RrdReader(path).stream().to_chunks():
        batch, entity = chunk.to_record_batch(), str(chunk.entity_path).strip("/").split("/")
        times = batch[SCENE].to_pylist() if SCENE in batch.schema.names else []
        for time, row in zip(times, batch.to_pylist(), strict=False):
            if row.get("SegmentationImage:buffer") and entity[1] not in ("table", "truth"):
                buffers[entity[0], entity[1], time] = np.array(row["SegmentationImage:buffer"][0], np.uint8)
            if entity[1:] == ["titles"] and row.get("Points2D:labels"):
                titles[entity[0], time] = row["Points2D:labels"][0]
    maps = {(u, v, titles[u, t]): b.reshape(2 * [round(len(b) ** 0.5)]) for (u, v, t), b in buffers.items()}
    if not maps:
        raise InputError(f"{path} holds no models' maps: expected an overview by stage record")
    return maps


def write_comparison(path: Path, before: Maps, now: Maps) -> int:
    """Write what both overviews show to `path`; return the number of cells that were right before and are wrong now.

    Scenes of one title are the same if their truth is.
    """

    def truth(classes: Array) -> Array:
        return np.isin(classes - views.OUTCOME, (ACCEPTED, FALSELY_INVALID))

    shared = [key for key in before if key in now and np.array_equal(truth(before[key]), truth(now[key]))]
    if not shared:
        raise InputError("the two commits share no model and scene: expected the same users, variants and root seed")
    changes = {}
    for key in shared:
        right = [np.isin(maps[key] - views.OUTCOME, (ACCEPTED, REJECTED)).astype(int) for maps in (before, now)]
        changes[key] = CLASSES[right[0], right[1]]
    worse = {key: int((change == FALSELY_VALID).sum()) for key, change in changes.items()}
    variants, users = ([*dict.fromkeys(key[i] for key in shared)] for i in (1, 0))
    places = {variant: divmod(i, COLUMNS) for i, variant in enumerate(variants)}
    shape = (len(variants) - 1) // COLUMNS + 1, min(len(variants), COLUMNS)
    tabs = [views.beside_text(f"{user} user", views.board(shape, f"/{user}/**"), "compared") for user in users]
    time = rrb.TimePanel(state="collapsed", timeline=SCENE, play_state="paused")
    with views.recording_at(path, "compared", views.tabbed("compared", tabs, time)) as recording:
        views.log_texts(recording, TEXT, {"compared": TEXT})
        for user in users:
            scenes = dict.fromkeys(scene for u, _, scene in shared if u == user)
            total = {s: sum(n for (u, _, scene), n in worse.items() if (u, scene) == (user, s)) for s in scenes}
            for step, name in enumerate(sorted(scenes, key=lambda s: -total[s])):
                recording.set_time(SCENE, sequence=step)
                counts = {v: worse[user, v, name] for v in variants if (user, v, name) in worse}
                titles = {places[v]: f"{name}, {label(v)}: {n} cells worse" for v, n in counts.items()}
                views.log_titles(recording, user, titles)
                for variant in counts:
                    change = changes[user, variant, name]
                    image = rr.SegmentationImage((views.OUTCOME + change).astype(np.uint8), opacity=1.0)
                    recording.log(f"{user}/{variant}/map", image, views.panel(places[variant], len(change)))
    return sum(worse.values())
