"""Stage recording: write a Rerun recording of the arm over the table, before the repair and after it.

{before,after}/{chain,shaker,items,path}   the path, and what moves along it
table, robot, margins                      what stays
clearance, joints                          series along the paths

Lengths are in metres in the table's frame, z above its top.
"""

import argparse
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

import matplotlib
import numpy as np
import pandas as pd
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float
from numpy import ndarray as Array
from omegaconf import DictConfig
from scipy.spatial.transform import Rotation

from pipeline.artifacts.files import read_arrays, write_table
from pipeline.launch import load
from pipeline.runtime.errors import InputError
from pipeline.runtime.places import PARAMS
from pipeline.runtime.writing import atomic_write
from pipeline.viewer import scene
from pipeline.viewer.digest import digest
from pipeline.viewer.geometry import footprints, kept_clear
from pipeline.viewer.scene import INVALID, KEPT_CLEAR, START, VALID, log_static, log_texts, recording_at
from pipeline.world.bezier import curve
from pipeline.world.layout import Layouts

NAME, TIMELINE = "execution", "time"
WHEN = {"before": INVALID, "after": VALID}  # first axis of the study's arrays, with the colours of their paths
ARM, BODY, WOOD, BACKDROP = (225, 228, 232), (128, 134, 142), (96, 78, 62), (38, 40, 46)  # RGB
POINTS, LIFT_M, SLAB_M = 65, 0.002, 0.03  # points of a curve; of lines above the table; thickness of the table's top
EYE, TARGET = (-0.25, 1.25, 0.95), (0.36, 0.27, 0.05)  # of the views
Arrays = Mapping[str, np.ndarray]
TEXT = """
The PR2’s right arm carries a shaker over a table that no model has seen. Press play.

- **Left:** a random path. The careful user rejects it.
- **Right:** its repair, by search with the clearance model.
- **On the table:** the path, and in white the margins that the careful user keeps.
- **Items:** solids over their footprints. They stand free, and a simulation of physics moves those that are met.
- **Robot:** its arm as capsules, the rest as boxes around its parts.

Below: the clearance along both paths from the items where they stood at first, negative where they overlap; and
the arm’s joints, none at a stop.
"""
ABOUT = """
# execution

- **Profile:** {profile}
- **Scenes’ root seed:** {seed}
- **Scene:** {scene}

To reproduce it, run `dvc repro studies/execution/dvc.yaml`.
`python -m pipeline.viewer.review execution --check` compares its contents with their digest in recordings.csv.
"""


def record(cfg: DictConfig, arrays: Arrays, folder: Path) -> None:
    """Write execution.rrd and recordings.csv, its digest; a recording of the same contents keeps its bytes."""
    path, new = folder / f"{NAME}.rrd", folder / f"{NAME}.new.rrd"
    folder.mkdir(parents=True, exist_ok=True)
    atomic_write(new, lambda part: write(part, cfg, arrays))
    if path.is_file() and digest(path) == digest(new):
        new.unlink()
    else:
        shutil.move(new, path)
    row = {"run": NAME, "sha256": digest(path), "accuracy": None}  # the columns of the paper's recordings
    write_table(folder / "recordings.csv", pd.DataFrame([row]))


def write(path: Path, cfg: DictConfig, arrays: Arrays) -> None:
    """Write the recording with its blueprint."""
    with recording_at(path, NAME, blueprint()) as recording:
        about = ABOUT.format(profile=cfg.profile, seed=cfg.scenes.root_seed, scene=arrays["scene"])
        log_texts(recording, about, {NAME: TEXT})
        log_what_stays(recording, arrays, cfg.users[next(iter(cfg.users))])
        for index, (when, colour) in enumerate(WHEN.items()):
            log_items(recording, f"{when}/items", arrays)
            path_on_table = on_top(arrays["side_m"] * curve(arrays["z_theta"][index], POINTS))
            log_static(recording, f"{when}/path", rr.LineStrips3D([path_on_table], colors=[colour], radii=0.006))
            log_movement(recording, when, arrays, index)
            name = f"{when} the repair"
            log_static(recording, f"clearance/{when}", rr.SeriesLines(names=name, colors=[colour], widths=2.5))
        names = [str(name).removesuffix("_joint") for name in arrays["joints"]]
        colours = [tuple(round(255 * part) for part in matplotlib.colormaps["Set2"](i)[:3]) for i in range(len(names))]
        log_static(recording, "joints", rr.SeriesLines(names=names, colors=colours))


def blueprint() -> rrb.Blueprint:
    """Return two views of the table, before and after the repair, over the series, with the text beside them."""
    eye = rrb.EyeControls3D(position=EYE, look_target=TARGET, eye_up=(0, 0, 1))
    views = [
        rrb.Spatial3DView(
            origin="/",
            name=f"{when.capitalize()} the repair",
            contents=["/table/**", "/robot", "/margins", f"/{when}/**"],
            background=BACKDROP,
            line_grid=False,
            eye_controls=eye,
        )
        for when in WHEN
    ]
    series = [
        rrb.TimeSeriesView(origin=origin, name=name, plot_legend=rrb.PlotLegend(corner))
        for origin, name, corner in (
            ("clearance", "Clearance of shaker and gripper from the nearest item [mm]", rrb.Corner2D.LeftTop),
            ("joints", "Joints after the repair: place between their stops, 0 to 1", rrb.Corner2D.RightBottom),
        )
    ]
    shown = rrb.Vertical(rrb.Horizontal(*views), rrb.Horizontal(*series), row_shares=[5, 2])
    time = rrb.TimePanel(state="collapsed", timeline=TIMELINE, loop_mode="all")
    return scene.tabbed(NAME, [scene.beside_text("Before and after the repair", shown, NAME)], time)


def log_what_stays(recording: rr.RecordingStream, arrays: Arrays, margins: Mapping[str, float | None]) -> None:
    """Log the table with the scene's picture, the margins that the user keeps, and the robot's body."""
    side, image = float(arrays["side_m"]), arrays["image"]
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
    picture = rr.Mesh3D(
        vertex_positions=np.c_[side * corners, np.zeros(4)],
        triangle_indices=[[0, 1, 2], [0, 2, 3]],
        vertex_texcoords=in_image(corners),
        vertex_normals=[[0, 0, 1]] * 4,
        albedo_texture=image,
    )
    log_static(recording, "table/picture", picture)
    half, middle = [side / 2, side / 2, SLAB_M / 2], [side / 2, side / 2, -SLAB_M / 2 - LIFT_M]
    top = rr.Boxes3D(half_sizes=[half], centers=[middle], colors=[WOOD], fill_mode="solid")
    log_static(recording, "table/top", top)
    rings = [on_top(side * ring) for _, ring in kept_clear(layout_of(arrays), margins)]
    log_static(recording, "margins", rr.LineStrips3D(rings, colors=[KEPT_CLEAR], radii=0.002))
    sides, centre, turn = np.split(arrays["bodies"], [3, 6], axis=1)
    boxes = rr.Boxes3D(half_sizes=sides / 2, centers=centre, quaternions=turn, colors=[BODY], fill_mode="solid")
    log_static(recording, "robot", boxes)


def log_items(recording: rr.RecordingStream, entity: str, arrays: Arrays) -> None:
    """Log each item as an upright prism over its footprint, painted with its part of the picture."""
    layout, side = layout_of(arrays), float(arrays["side_m"])
    for slot, (_, ring) in zip(np.flatnonzero(layout.present[0]), footprints(layout), strict=True):
        ring, height = ring[:-1], float(arrays["heights"][slot])
        n, place, turn = len(ring), arrays["items"][0, 0, slot, :3], arrays["items"][0, 0, slot, 3:]
        flat = np.concatenate([ring, ring, ring, ring.mean(0, keepdims=True)])  # foot, edge, and top with its middle
        z = np.repeat([0.0, height, height], [n, n, n + 1])
        corners = Rotation.from_quat(turn, scalar_first=True).inv().apply(np.c_[side * flat, z] - place)
        here, there = np.arange(n), np.roll(np.arange(n), -1)
        wall = np.concatenate([np.c_[here, there, n + there], np.c_[here, n + there, n + here]])
        top = np.c_[2 * n + here, 2 * n + there, np.full(n, 3 * n)]
        outwards = np.c_[ring - ring.mean(0), np.zeros(n)]
        outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
        solid = rr.Mesh3D(
            vertex_positions=corners,
            triangle_indices=np.concatenate([wall, top]),
            vertex_normals=np.concatenate([outwards, outwards, np.tile([0.0, 0.0, 1.0], (n + 1, 1))]),
            vertex_texcoords=in_image(flat),
            albedo_texture=arrays["image"],
        )
        log_static(recording, f"{entity}/{slot}", solid)


def log_movement(recording: rr.RecordingStream, when: str, arrays: Arrays, index: int) -> None:
    """Log arm, shaker, items and series at each instant of one path."""
    radius, below, above = arrays["shaker"]
    slots = np.flatnonzero(layout_of(arrays).present[0])
    for instant, seconds in enumerate(arrays["t"][index]):
        recording.set_time(TIMELINE, duration=float(seconds))
        recording.log(f"{when}/chain", capsules(arrays["chain"][index, instant], arrays["thickness"]))
        grip = arrays["grip"][index, instant]
        middle = grip + np.array([0.0, 0.0, (above - below) / 2])
        shaker = rr.Cylinders3D(
            lengths=[below + above], radii=[radius], centers=[middle], colors=[START], fill_mode="solid"
        )
        recording.log(f"{when}/shaker", shaker)
        for slot in slots:
            x, y, z, *turn = arrays["items"][index, instant, slot]
            moved = rr.Transform3D(translation=[x, y, z], quaternion=rr.Quaternion(xyzw=np.roll(turn, -1)))
            recording.log(f"{when}/items/{slot}", moved)
        recording.log(f"clearance/{when}", rr.Scalars(1e3 * arrays["clearance"][index, instant]))
        if index == 1:
            recording.log("joints", rr.Scalars(arrays["share"][index, instant]))


def capsules(chain: Float[Array, "place 3"], thickness: Float[Array, " joint"]) -> rr.Capsules3D:
    """Return capsules around the links between joints that lie apart."""
    along = np.diff(chain, axis=0)
    lengths = np.linalg.norm(along, axis=1)
    apart = lengths > 1e-6
    turns = [Rotation.align_vectors(one, [0, 0, 1])[0].as_quat() for one in along[apart]]
    radii = np.maximum.accumulate(thickness[::-1])[::-1][apart]
    return rr.Capsules3D(
        lengths=lengths[apart], radii=radii, translations=chain[:-1][apart], quaternions=turns, colors=[ARM],
        fill_mode="solid",
    )  # fmt: skip


def on_top(points: Float[Array, "point 2"]) -> Float[Array, "point 3"]:
    """Return points [m] just above the table's top."""
    return np.c_[points, np.full(len(points), LIFT_M)]


def in_image(points: Float[Array, "point 2"]) -> Float[Array, "point 2"]:
    """Return points [table sides] as places in the picture, whose first row is the far edge."""
    return np.stack([points[:, 0], 1.0 - points[:, 1]], -1)


def layout_of(arrays: Arrays) -> Layouts:
    """Return the layout of the one scene."""
    prefix = "layout/"
    return Layouts(**{name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)})


def main(argv: list[str]) -> None:
    """Read the study's arrays and write the recording into the study's folder."""
    parser = argparse.ArgumentParser(prog="python -m studies.execution.recording", description=__doc__)
    parser.add_argument("--params", type=Path, default=PARAMS, metavar="FILE")
    cfg = load(parser.parse_args(argv).params)
    record(cfg, read_arrays(Path(cfg.paths.studies) / NAME / "shown.npz"), Path(__file__).parent / "recording")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
