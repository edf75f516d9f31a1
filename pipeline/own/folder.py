"""Read and check a person's folder (docs/own-tables.md): every fault becomes a sentence before anything runs."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml
from jaxtyping import UInt8
from numpy import ndarray as Array

from pipeline.own.csv_files import Faults, check_names, normal, numbers, read_csv, row_numbers
from pipeline.own.frame import Frame, rectify
from pipeline.own.pictures import ENDINGS, read_cutout, read_picture
from pipeline.runtime.errors import InputError
from pipeline.world.hand import MAX_BEYOND_M

SCENES, KINDS, SETTINGS = "scenes", "kinds", "table.yaml"
DEMONSTRATIONS, ITEMS, CUTOUTS = "demonstrations.csv", "items.csv", "kinds.csv"
KEY = ["scene", "user", "demo"]
ENDS_WITHIN_M = 0.05  # largest distance of a path's ends from start and goal [m]; a hand that is not in a hurry
MIN_SAMPLES = 3  # rows of a demonstration
MIN_SCENES = 4  # scenes of a user: fewer leave nothing to fit on and nothing to judge by
MIN_APART = 0.2  # smallest distance from start to goal, relative to the table's side
MIN_TABLE_PX = 50  # shortest side of the table in a picture
SIDES_M = (0.1, 10.0)  # side of a table [m]
DEFAULT_START, DEFAULT_GOAL = (0.08, 0.08), (0.92, 0.92)  # the paper's ends, relative to the table's side
SQUARE_WITHIN = 0.02  # a picture of just the table is square within this share


@dataclass
class Settings:
    """Hold what table.yaml says: side [m], corners (4, 2) of all scenes or by scene [px], start and goal (2,) [m]."""

    side_m: float = 1.0
    corners: Array | dict[str, Array] | None = None
    rectified: bool = False
    start: Array = field(default_factory=lambda: np.array(DEFAULT_START))
    goal: Array = field(default_factory=lambda: np.array(DEFAULT_GOAL))

    def corners_of(self, scene: str) -> Array | None:
        """Return the corners (4, 2) [column, row] of the table in a scene's picture; None: the whole picture."""
        return self.corners.get(scene) if isinstance(self.corners, dict) else self.corners


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
    samples = _read_samples(path, scenes, settings, faults) if settings else None
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


# table.yaml


def read_settings(path: Path, faults: Faults) -> Settings | None:
    """Return the settings of table.yaml, or the defaults; None after a fault."""
    if not (path / SETTINGS).is_file():
        return Settings(rectified=True)
    try:
        content = yaml.safe_load((path / SETTINGS).read_text(encoding="utf-8")) or {}
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        faults.append(f"{SETTINGS} cannot be read: {' '.join(str(error).split())}; correct it")
        return None
    known = ("side_m", "corners", "rectified", "start", "goal")
    if not isinstance(content, dict) or set(content) - set(known):
        names = ", ".join(map(str, content)) if isinstance(content, dict) else type(content).__name__
        faults.append(f"{SETTINGS} holds {names}: expected some of {', '.join(known)}")
        return None
    before = len(faults)
    side = content.get("side_m", 1.0)
    if not _is_number(side) or not SIDES_M[0] <= side <= SIDES_M[1]:
        faults.append(f"{SETTINGS}: side_m is {side!r}: expected metres from {SIDES_M[0]} to {SIDES_M[1]:g}")
        return None
    settings = Settings(float(side))
    settings.rectified = content.get("rectified", False)
    if not isinstance(settings.rectified, bool):
        faults.append(f"{SETTINGS}: rectified is {settings.rectified!r}: expected true or false")
    settings.start = _point(content, "start", DEFAULT_START, side, faults)
    settings.goal = _point(content, "goal", DEFAULT_GOAL, side, faults)
    if len(faults) == before and np.linalg.norm(settings.goal - settings.start) < MIN_APART * side:
        faults.append(f"{SETTINGS}: start and goal are closer than {MIN_APART * side:g} m: expected two places")
    settings.corners = _corners(content.get("corners"), faults)
    if settings.corners is not None and settings.rectified:
        faults.append(f"{SETTINGS}: corners and rectified: true exclude each other: remove one of them")
    if settings.corners is None and "corners" not in content:
        settings.rectified = True
    return settings if len(faults) == before else None


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _point(content: Mapping, name: str, default: tuple[float, float], side: float, faults: Faults) -> Array:
    value = content.get(name, [side * c for c in default])
    if isinstance(value, list) and len(value) == 2 and all(_is_number(v) and 0 <= v <= side for v in value):
        return np.array(value, float)
    faults.append(f"{SETTINGS}: {name} is {value!r}: expected [x, y] in metres on the table, 0 to {side:g}")
    return np.zeros(2)


def _corners(value: Any, faults: Faults) -> Array | dict[str, Array] | None:
    """Return corners of all scenes or by scene; add a fault unless each is a quadrilateral in the right order."""
    if value is None:
        return None
    if isinstance(value, dict):
        made = {normal(str(scene)): _quadrilateral(points, f" of {scene}", faults) for scene, points in value.items()}
        return {scene: points for scene, points in made.items() if points is not None}
    return _quadrilateral(value, "", faults)


def _quadrilateral(value: Any, whose: str, faults: Faults) -> Array | None:
    name = f"{SETTINGS}: corners{whose}"
    order = "far left, far right, near right, near left"
    pairs = isinstance(value, list) and len(value) == 4 and all(isinstance(p, list) and len(p) == 2 for p in value)
    if not pairs or not all(_is_number(number) for pair in value for number in pair):
        faults.append(f"{name} are {value!r}: expected four [column, row] in pixels, {order}")
        return None
    points = np.array(value, float)
    sides = np.roll(points, -1, axis=0) - points
    turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
    if (turns < 0).all():
        faults.append(f"{name} run counter-clockwise: expected {order}")
    elif not (turns > 0).all():
        faults.append(f"{name} cross or lie on a line: expected a convex quadrilateral, {order}")
    elif np.linalg.norm(sides, axis=1).min() < MIN_TABLE_PX:
        faults.append(f"{name} are less than {MIN_TABLE_PX} pixels apart: expected a larger table in the picture")
    else:
        return points
    return None


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


# demonstrations.csv


def _read_samples(path: Path, scenes: Mapping[str, Path], settings: Settings, faults: Faults) -> pd.DataFrame | None:
    """Return the samples of all demonstrations, sorted by demonstration and in their own order; None after a fault."""
    file, before = DEMONSTRATIONS, len(faults)
    if not (path / file).is_file():
        faults.append(f"{file} is missing: draw paths with `python -m pipeline.own record {path}`, or write it")
        return None
    try:
        text = read_csv(path / file, [*KEY, "t", "x", "y", "valid"])
    except InputError as error:
        faults.append(str(error))
        return None
    if text.empty:
        faults.append(f"{file} has no row below its header: expected demonstrations")
        return None
    check_names(text, KEY, file, faults)
    names = text["scene"].tolist()
    faults.rows(
        file,
        ~text["scene"].isin(scenes.keys()).to_numpy(),
        lambda i: f"scene {names[i]!r} has no picture in {SCENES}/: add it, or correct the name",
        row_numbers(text),
    )
    made = numbers(text, ["t", "x", "y"], file, faults)
    words = text["valid"].str.lower()
    faults.rows(
        file,
        ~words.isin(["true", "false"]).to_numpy(),
        lambda i: f"valid is {text['valid'].iloc[i]!r}: expected true or false",
        row_numbers(text),
    )
    if len(faults) > before:
        return None
    samples = pd.concat([text[KEY], made], axis=1).assign(valid=words == "true", row=row_numbers(text))
    samples = samples.sort_values(KEY, kind="stable", ignore_index=True)
    _check_demonstrations(samples, settings, faults)
    _check_users(samples, faults)
    return samples if len(faults) == before else None


def _check_demonstrations(samples: pd.DataFrame, settings: Settings, faults: Faults) -> None:
    """Add faults of whole demonstrations: labels, length, times, ends."""
    file, rows = DEMONSTRATIONS, samples["row"].to_numpy()
    number = samples.groupby(KEY, sort=False).ngroup().to_numpy()
    first, last = np.flatnonzero(np.diff(number, prepend=-1)), np.flatnonzero(np.diff(number, append=-1))
    names = [", ".join(key) for key in samples.loc[first, KEY].itertuples(index=False)]
    same = np.diff(number, prepend=-1) == 0
    t, x, y, valid = (samples[name].to_numpy() for name in ("t", "x", "y", "valid"))
    faults.rows(
        file,
        same & (valid != np.roll(valid, 1)),
        lambda i: f"valid changes within demonstration ({names[number[i]]}): expected one word for all of it",
        rows,
    )
    back = same & (t < np.roll(t, 1))
    faults.rows(
        file,
        back,
        lambda i: (
            f"t goes back from {t[i - 1]:g} to {t[i]:g} s in demonstration ({names[number[i]]}): expected times that "
            "increase, and a name of its own for each demonstration"
        ),
        rows,
    )
    length = last - first + 1
    faults.rows(
        file,
        length < MIN_SAMPLES,
        lambda i: f"demonstration ({names[i]}) has {length[i]} rows: expected at least {MIN_SAMPLES}",
        rows[first],
    )
    points = np.stack([x, y], -1)
    for verb, ends, place in (("starts", first, settings.start), ("ends", last, settings.goal)):
        away = np.linalg.norm(points[ends] - place, axis=1)
        goal = "start" if verb == "starts" else "goal"
        faults.rows(
            file,
            away > ENDS_WITHIN_M,
            lambda i, verb=verb, ends=ends, place=place, away=away, goal=goal: (
                f"demonstration ({names[i]}) {verb} at ({x[ends[i]]:.3g}, {y[ends[i]]:.3g}) m, {away[i]:.2g} m from "
                f"the {goal} ({place[0]:g}, {place[1]:g}): expected at most {ENDS_WITHIN_M:g} m; positions are in "
                f"metres, and {SETTINGS} sets the {goal}"
            ),
            rows[ends],
        )
    beyond = np.maximum(-points, points - settings.side_m).max(1)
    faults.rows(
        file,
        beyond > MAX_BEYOND_M * settings.side_m,
        lambda i: (
            f"the path is at ({x[i]:g}, {y[i]:g}) m, far off the table: expected metres from 0 to {settings.side_m:g}"
        ),
        rows,
    )


def _check_users(samples: pd.DataFrame, faults: Faults) -> None:
    """Add a fault for each user with too few scenes or with labels of one kind."""
    demos = samples.drop_duplicates(KEY)
    for user, rows in demos.groupby("user"):
        scenes, row = rows["scene"].nunique(), rows["row"].min()
        if scenes < MIN_SCENES:
            faults.append(
                f"{DEMONSTRATIONS}, row {row}: user {user} has {scenes} scenes: expected at least {MIN_SCENES}; add "
                "demonstrations, or leave the user out"
            )
        if rows["valid"].nunique() == 1:
            word = "valid" if rows["valid"].iloc[0] else "invalid"
            faults.append(
                f"{DEMONSTRATIONS}, row {row}: all {len(rows)} demonstrations of user {user} are {word}: expected both "
                "valid and invalid ones; add the other kind, or leave the user out"
            )


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
