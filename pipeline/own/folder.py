"""Read and check a person's folder (docs/own-tables.md): every fault becomes a sentence before anything runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.own.csv_files import Faults, check_names, normal, numbers, read_csv, row_numbers
from pipeline.own.demonstrations import DEMONSTRATIONS, KEY, read_samples
from pipeline.own.frame import Frame, rectify
from pipeline.own.pictures import ENDINGS, read_cutout, read_picture
from pipeline.own.settings import SETTINGS, SIDES_M, Settings, read_settings
from pipeline.runtime.errors import InputError

SCENES, KINDS, ITEMS, CUTOUTS = "scenes", "kinds", "items.csv", "kinds.csv"
SQUARE_WITHIN = 0.02  # a picture of just the table is square within this share


@dataclass
class Folder:
    """Hold all that a folder contains, checked.

    samples: a row for each sample: scene, user, demo, t [s], x, y [m on the table], valid; sorted by demonstration.
    """

    path: Path
    frame: Frame
    settings: Settings
    canvases: dict[str, UInt8[Array, "side side 3"]]  # rectified tables by scene
    samples: pd.DataFrame
    empty: UInt8[Array, "side side 3"] | None = None
    items: pd.DataFrame | None = None  # scene, kind, x, y, angle_deg, radius_m, half_length_m
    cutouts: dict[str, list[tuple[UInt8[Array, "row column 4"], float]]] = field(default_factory=dict)  # with width [m]
    notes: list[str] = field(default_factory=list)

    @property
    def users(self) -> list[str]:
        """Return the users in the order of their names."""
        return sorted(self.samples["user"].unique())


def read_folder(path: Path) -> tuple[Folder | None, Faults]:
    """Return what the folder holds, or None and a sentence for each fault."""
    faults = Faults()
    if not path.is_dir():
        faults.append(f"{path} is not a folder: expected one with {SCENES}/ and {DEMONSTRATIONS}")
        return None, faults
    outside = _links_out(path)
    faults += [f"{name} is a link out of the folder: replace it by the file itself" for name in outside]
    if outside:
        return None, faults
    scenes = scene_files(path, faults)
    settings = read_settings(path, faults)
    samples = read_samples(path, scenes, settings, faults) if settings else None
    items = _read_items(path, scenes, faults)
    cutouts = _read_cutouts(path, faults)
    canvases = _read_canvases(scenes, settings, faults) if settings else {}
    empty = _read_empty(path, settings, faults) if settings else None
    if faults or settings is None or samples is None:
        return None, faults
    frame = Frame.between(settings.side_m, settings.start, settings.goal)
    folder = Folder(path, frame, settings, canvases, samples, empty, items, cutouts)
    folder.notes += _notes(folder)
    return folder, faults


def _links_out(path: Path) -> list[str]:
    """Return the names of links that lead out of the folder."""
    root = path.resolve()
    links = [entry for entry in (path, *path.rglob("*")) if entry.is_symlink() and entry != path]
    return [str(link.relative_to(path)) for link in links if not link.resolve().is_relative_to(root)]


def scene_files(path: Path, faults: Faults) -> dict[str, Path]:
    """Return the picture of each scene by name, in the order of the names."""
    if not (path / SCENES).is_dir():
        faults.append(f"{SCENES}/ is missing: expected a folder with a picture of each scene")
        return {}
    found: dict[str, Path] = {}
    for file in sorted(path.joinpath(SCENES).iterdir()):
        if file.suffix.lower() not in ENDINGS or file.name.startswith("."):
            continue
        name = normal(file.stem)
        if not name.isprintable():
            faults.append(f"{SCENES}/{file.name!r} has characters that cannot be printed: rename it")
        elif name in found:
            faults.append(f"{SCENES}/{file.name} and {found[name].name} are one scene {name!r}: rename one of them")
        else:
            found[name] = file
    if not found:
        faults.append(f"{SCENES}/ holds no picture: expected files that end in {', '.join(ENDINGS)}")
    return found


# Pictures


def _read_canvases(scenes: Mapping[str, Path], settings: Settings, faults: Faults) -> dict[str, Array]:
    canvases = {}
    if isinstance(settings.corners, dict):
        for scene in settings.corners.keys() - scenes.keys():
            faults.append(f"{SETTINGS}: corners of {scene}: {SCENES}/ has no such picture; correct the name")
    for scene, file in scenes.items():
        corners = settings.corners_of(scene)
        if corners is None and not settings.rectified:
            faults.append(f"{SETTINGS}: no corners of {scene}: add them, as for the other scenes")
            continue
        canvas = _read_canvas(file, f"{SCENES}/{file.name}", corners, faults)
        if canvas is not None:
            canvases[scene] = canvas
    return canvases


def _read_canvas(file: Path, name: str, corners: Array | None, faults: Faults) -> Array | None:
    """Return a rectified picture, or None after a fault."""
    try:
        picture = read_picture(file)
    except (InputError, OSError) as error:
        faults.append(f"{name} {error}")
        return None
    height, width = picture.shape[:2]
    if corners is None and abs(width - height) > SQUARE_WITHIN * max(width, height):
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


def _read_empty(path: Path, settings: Settings, faults: Faults) -> Array | None:
    files = [file for ending in ENDINGS if (file := path / f"empty{ending}").is_file()]
    if not files:
        return None
    if isinstance(settings.corners, dict):
        faults.append(f"{files[0].name} needs a fixed camera, and corners differ by scene: remove one of them")
        return None
    return _read_canvas(files[0], files[0].name, settings.corners, faults)


# items.csv, kinds.csv


def _read_items(path: Path, scenes: Mapping[str, Path], faults: Faults) -> pd.DataFrame | None:
    """Return items.csv, checked; None if there is none or after a fault."""
    columns = ["x", "y", "angle_deg", "radius_m", "half_length_m"]
    text = _read_optional(path, ITEMS, ["scene", "kind", *columns], faults)
    if text is None or text.empty:
        return None
    before = len(faults)
    check_names(text, ["scene", "kind"], ITEMS, faults)
    names = text["scene"].tolist()
    faults.rows(
        ITEMS,
        ~text["scene"].isin(scenes.keys()).to_numpy(),
        lambda i: f"scene {names[i]!r} has no picture in {SCENES}/: add it, or correct the name",
        row_numbers(text),
    )
    made = numbers(text, columns, ITEMS, faults)
    for column, wrong in (("radius_m", made["radius_m"] <= 0), ("half_length_m", made["half_length_m"] < 0)):
        values = made[column].tolist()
        faults.rows(
            ITEMS,
            wrong.to_numpy(),
            lambda i, column=column, values=values: f"{column} is {values[i]:g}: expected metres above 0",
            row_numbers(text),
        )
    return pd.concat([text[["scene", "kind"]], made], axis=1).reset_index(drop=True) if len(faults) == before else None


def _read_optional(path: Path, file: str, columns: list[str], faults: Faults) -> pd.DataFrame | None:
    if not (path / file).is_file():
        return None
    try:
        return read_csv(path / file, columns)
    except InputError as error:
        faults.append(str(error))
        return None


def _read_cutouts(path: Path, faults: Faults) -> dict[str, list[tuple[Array, float]]]:
    """Return each kind's cut-outs with the width of their pictures [m]; add a fault for a kind without one."""
    folders = (
        {normal(f.name): f for f in sorted((path / KINDS).iterdir()) if f.is_dir()} if (path / KINDS).is_dir() else {}
    )
    if folders and not (path / CUTOUTS).is_file():
        faults.append(f"{CUTOUTS} is missing: expected the columns kind, file, width_m and a row for each cut-out")
        return {}
    files = {(kind, normal(f.name)): f for kind, folder in folders.items() for f in sorted(folder.glob("*.png"))}
    text = _read_optional(path, CUTOUTS, ["kind", "file", "width_m"], faults)
    if text is None:
        return {}
    check_names(text, ["kind", "file"], CUTOUTS, faults)
    widths = numbers(text, ["width_m"], CUTOUTS, faults)["width_m"].tolist()
    listed = list(zip(text["kind"], text["file"], widths, row_numbers(text), strict=True))
    cutouts: dict[str, list[tuple[Array, float]]] = {}
    named: set[tuple[str, str]] = set()
    for kind, file, width, row in listed:
        where, place = f"{CUTOUTS}, row {row}", files.get((kind, file))
        named.add((kind, file))
        if place is None:
            faults.append(f"{where}: {KINDS}/{kind}/{file} is missing: add the cut-out, or remove the row")
            continue
        if not 0 < width <= SIDES_M[1]:
            faults.append(f"{where}: width_m is {width:g}: expected the picture's width in metres, above 0")
            continue
        try:
            cutouts.setdefault(kind, []).append((read_cutout(place), float(width)))
        except (InputError, OSError) as error:
            faults.append(f"{where}: {KINDS}/{kind}/{file} {error}")
    for kind in folders.keys() - {kind for kind, _ in files}:
        faults.append(f"{KINDS}/{kind} holds no cut-out: add a png with a transparent background, or remove it")
    for kind, file in files.keys() - named:
        faults.append(f"{KINDS}/{kind}/{file} has no row in {CUTOUTS}: add one with its width_m")
    return cutouts


def _notes(folder: Folder) -> list[str]:
    """Return remarks that are no faults."""
    notes = []
    unlabelled = folder.canvases.keys() - set(folder.samples["scene"])
    if unlabelled:
        notes.append(f"{len(unlabelled)} scenes have no demonstration: the report says which to show next")
    if not folder.cutouts:
        notes.append(f"no {KINDS}/ with cut-outs: the report cannot ask what users react to")
    if folder.items is None:
        notes.append(f"no {ITEMS}: the report cannot count detected items")
    elif missing := sorted(set(folder.items["kind"]) - folder.cutouts.keys()):
        notes.append(f"no cut-outs of {', '.join(missing)}: the report does not ask whether users react to them")
    counts = folder.samples.drop_duplicates(KEY).groupby(["user", "scene"]).size().groupby("user").agg(["min", "max"])
    for user, row in counts.iterrows():
        if row["max"] > 2 * row["min"]:
            notes.append(
                f"user {user} has {row['min']} to {row['max']} demonstrations a scene: each scene counts the same"
            )
    return notes
