"""Read and check a person's folder (docs/own-tables.md): every fault becomes a sentence before anything runs."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.own.csv_files import CUTOUTS, DEMONSTRATIONS, ITEMS, KEY, Faults, normal, read_checked
from pipeline.own.demonstrations import read_samples
from pipeline.own.frame import Frame, rectify, without_pattern
from pipeline.own.paths import fit_demonstrations
from pipeline.own.pictures import ENDINGS, KINDS, SCENES, is_square, read_cutout, read_picture, scene_files
from pipeline.own.settings import SETTINGS, SIDES_M, read_settings
from pipeline.runtime.errors import InputError


@dataclass(frozen=True)
class Folder:
    """Hold all that a folder contains, checked."""

    path: Path
    frame: Frame
    canvases: dict[str, UInt8[Array, "side side 3"]]  # rectified tables by scene
    demos: pd.DataFrame  # a row for each demonstration (`paths.fit_demonstrations`)
    empty: UInt8[Array, "100 100 3"] | None  # the model's image of the empty table
    items: pd.DataFrame | None  # scene, kind, x, y, angle_deg, radius_m, half_length_m
    cutouts: dict[str, list[tuple[UInt8[Array, "row column 4"], float]]]  # by kind, with width [m]

    @property
    def users(self) -> list[str]:
        """Return the users in the order of their names."""
        return sorted(self.demos["user"].unique())

    @property
    def notes(self) -> list[str]:
        """Return remarks that are no faults."""
        notes, demos = [], self.demos
        if unlabelled := self.canvases.keys() - set(demos["scene"]):
            notes.append(f"{len(unlabelled)} scenes have no demonstration: the report says which to show next")
        if not self.cutouts:
            notes.append(f"no {KINDS}/ with cut-outs: the report cannot ask what users react to")
        if self.items is None:
            notes.append(f"no {ITEMS}: the report cannot count detected items")
        elif missing := sorted(set(self.items["kind"]) - self.cutouts.keys()):
            notes.append(f"no cut-outs of {', '.join(missing)}: the report does not ask whether users react to them")
        counts = demos.groupby(["user", "scene"]).size().groupby("user").agg(["min", "max"])
        for user, least, most in counts[counts["max"] > 2 * counts["min"]].itertuples():
            notes.append(f"user {user} has {least} to {most} demonstrations a scene, and each scene counts the same")
        more = demos[demos["needs_more"]]
        if len(more):
            notes.append(
                f"{len(more)} of {len(demos)} demonstrations need more than one control point, the first "
                f"({', '.join(more[KEY].iloc[0])}): they are fitted less closely"
            )
        return notes

    def image(self, canvas: UInt8[Array, "side side 3"]) -> UInt8[Array, "100 100 3"]:
        """Return a rectified table as the models see it: without its pattern, if there is a picture of it empty."""
        image = self.frame.image(canvas)
        return image if self.empty is None else without_pattern(image, self.empty)


def read_folder(path: Path) -> tuple[Folder | None, Faults]:
    """Return what the folder holds, or None and a sentence for each fault."""
    faults = Faults()
    if not path.is_dir():
        faults.append(f"{path} is not a folder: expected one with {SCENES}/ and {DEMONSTRATIONS}")
        return None, faults
    for link in path.rglob("*"):
        if link.is_symlink() and not link.resolve().is_relative_to(path.resolve()):
            faults.append(f"{link.relative_to(path)} is a link out of the folder: replace it by the file itself")
    if faults:
        return None, faults
    scenes, settings = scene_files(path, faults), None
    try:
        settings = read_settings(path)
    except InputError as error:
        faults += str(error).splitlines()
    samples = read_samples(path, scenes, settings, faults) if settings else None
    items = _read_items(path, scenes, faults)
    cutouts = _read_cutouts(path, faults)
    if settings is None:
        return None, faults
    by_scene = settings.corners if isinstance(settings.corners, dict) else {}
    for scene in sorted(by_scene.keys() - scenes.keys()):
        faults.append(f"{SETTINGS}: corners of {scene}: {SCENES}/ has no such picture; correct the name")
    canvases = {}
    for scene, file in scenes.items():
        corners = settings.corners_of(scene)
        if corners is None and not settings.rectified:
            faults.append(f"{SETTINGS}: no corners of {scene}: add them, as for the other scenes")
        elif (canvas := _read_canvas(file, f"{SCENES}/{file.name}", corners, faults)) is not None:
            canvases[scene] = canvas
    pictures = (f for f in sorted(path.iterdir()) if f.stem == "empty" and f.suffix.lower() in ENDINGS)
    empty, bare = next(pictures, None), None
    if empty is not None:
        if isinstance(settings.corners, dict):
            faults.append(f"{empty.name} needs a fixed camera, and corners differ by scene: remove one of them")
        else:
            bare = _read_canvas(empty, empty.name, settings.corners, faults)
    if faults or samples is None:
        return None, faults
    frame = Frame.between(settings.side_m, settings.start, settings.goal)
    demos = fit_demonstrations(samples, frame, faults)
    if faults:
        return None, faults
    return Folder(path, frame, canvases, demos, None if bare is None else frame.image(bare), items, cutouts), faults


def _read_canvas(file: Path, name: str, corners: Array | None, faults: Faults) -> Array | None:
    """Return a rectified picture, or None after a fault."""
    try:
        picture = read_picture(file)
    except (InputError, OSError) as error:
        faults.append(f"{name} {error}")
        return None
    height, width = picture.shape[:2]
    if corners is None and not is_square(width, height):
        faults.append(
            f"{name} has {width} x {height} pixels: expected a square picture of just the table, or corners in "
            f"{SETTINGS}"
        )
    elif corners is not None and ((corners < 0) | (corners > [width, height])).any():
        faults.append(f"{name} has {width} x {height} pixels, and corners in {SETTINGS} lie outside: correct them")
    else:
        canvas = rectify(picture, corners)
        if np.median(canvas.reshape(-1, 3), axis=0).any():
            return canvas
        faults.append(f"{name} is black where the table should be: expected a picture of it, or other corners")
    return None


def _read_items(path: Path, scenes: Collection[str], faults: Faults) -> pd.DataFrame | None:
    """Return items.csv; None if there is none, or none in it."""
    items = read_checked(path / ITEMS, scenes, faults) if (path / ITEMS).is_file() else None
    if items is None or items.empty:
        return None
    faults.rows(ITEMS, items[items["radius_m"] <= 0], "radius_m is {radius_m:g}: expected metres above 0")
    faults.rows(ITEMS, items[items["half_length_m"] < 0], "half_length_m is {half_length_m:g}: expected metres from 0")
    return items.reset_index(drop=True)


def _read_cutouts(path: Path, faults: Faults) -> dict[str, list[tuple[Array, float]]]:
    """Return each kind's cut-outs with the width of their pictures [m]; add a fault for a kind without one."""
    folders = {normal(folder.name): folder for folder in sorted(path.glob(f"{KINDS}/*/"))}
    if not (path / CUTOUTS).is_file():
        if folders:
            faults.append(f"{CUTOUTS} is missing: expected the columns kind, file, width_m and a row for each cut-out")
        return {}
    table = read_checked(path / CUTOUTS, (), faults)
    if table is None:
        return {}
    listed = [(kind, f) for kind, folder in folders.items() for f in sorted(folder.iterdir())]
    files = {(kind, normal(f.name)): f for kind, f in listed if f.suffix.lower() == ".png"}
    cutouts: dict[str, list[tuple[Array, float]]] = {}
    for row, kind, file, width in table.itertuples(name=None):
        where = f"{CUTOUTS}, row {row}:"
        if (kind, file) not in files:
            faults.append(f"{where} {KINDS}/{kind}/{file} is missing: add the cut-out, or remove the row")
        elif width <= 0 or width > SIDES_M[1]:
            faults.append(f"{where} width_m is {width:g}: expected the picture's width in metres, above 0")
        else:
            try:
                cutouts.setdefault(kind, []).append((read_cutout(files[kind, file]), width))
            except (InputError, OSError) as error:
                faults.append(f"{where} {KINDS}/{kind}/{file} {error}")
    for kind in sorted(folders.keys() - {kind for kind, _ in files}):
        faults.append(f"{KINDS}/{kind} holds no cut-out: add a png with a transparent background, or remove it")
    for kind, file in sorted(files.keys() - set(zip(table["kind"], table["file"], strict=True))):
        faults.append(f"{KINDS}/{kind}/{file} has no row in {CUTOUTS}: add one with its width_m")
    return cutouts
