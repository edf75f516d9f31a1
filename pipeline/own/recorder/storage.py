"""Store what is recorded in a folder: every change reads, checks and replaces one file, one change at a time."""

import hashlib
import math
import os
import re
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Annotated, Any, Literal

import cv2
import numpy as np
import pandas as pd
import yaml
from jaxtyping import Float
from numpy import ndarray as Array
from pydantic import ConfigDict, Field, FiniteFloat, validate_call

from pipeline.own.csv_files import COLUMNS, DEMONSTRATIONS, ITEMS, KEY, Faults, normal, read_checked, read_csv
from pipeline.own.frame import outline, whole
from pipeline.own.pictures import KINDS, SCENES, is_square, read_picture, scene_files
from pipeline.own.settings import (
    ENDS_WITHIN_M,
    MIN_SAMPLES,
    MIN_SCENES,
    SETTINGS,
    Settings,
    check_settings,
    read_settings,
)
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write
from pipeline.world.hand import MAX_BEYOND_M
from pipeline.world.images import PNG_SIGNATURE

HEADER = "# Where the table is in the pictures, written by the recorder. docs/own-tables.md says what each line is.\n"
MIN_STEP_S = 0.008  # between stored samples; some pens report 240 a second
MIN_RADIUS_M = 0.002  # of an item
MAX_NAME = 60  # characters of a person's or a kind's name
FORMULA = "=+-@"  # a spreadsheet runs a cell that begins so
FIELDS = 10  # of the grid over the table, a side
MIN_DEPTH = 1e-9  # relative to the picture's corner; no point of a table is so near to its horizon

Point = Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]
Points = Annotated[list[Point], Field(min_length=2, max_length=3)]
Corners = Annotated[list[Point], Field(min_length=4, max_length=4)]
Samples = Annotated[
    list[Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]], Field(min_length=1, max_length=100_000)
]
as_sent = validate_call(config=ConfigDict(strict=True))  # checks what a page sends as the arguments of a method


class Recordings:
    """The scenes, paths, items and the table of one folder. Its methods may be called from several threads."""

    def __init__(self, folder: Path) -> None:
        """Open a folder; raise InputError if what it holds cannot be read."""
        self.folder = folder
        self._lock = Lock()  # held by each change
        self._known: dict[Path, tuple[tuple[int, ...], Any]] = {}  # state of each file that was read, and its content
        self.overview()

    def overview(self) -> dict[str, Any]:
        """Return scenes, users, kinds, the number of paths and items, and start and goal."""
        scenes, settings = self._scenes(), self._settings()
        paths, items = self._table(DEMONSTRATIONS).drop_duplicates(KEY), self._table(ITEMS)
        counts: dict[str, dict[str, dict[str, int]]] = {scene: {} for scene in scenes}
        for scene, user, word in zip(paths["scene"], paths["user"], paths["valid"], strict=True):
            count = counts.setdefault(scene, {}).setdefault(user, {"valid": 0, "invalid": 0})
            count["valid" if word.lower() == "true" else "invalid"] += 1
        kinds = {normal(path.name) for path in self.folder.glob(f"{KINDS}/*/")}
        return {
            "folder": self.folder.resolve().name,
            "scenes": list(scenes),
            "users": list(dict.fromkeys(paths["user"])),
            "counts": counts,
            "items": items["scene"].value_counts().reindex(list(scenes), fill_value=0).to_dict(),
            "kinds": sorted(kinds | set(items["kind"])),
            "side_m": settings.side_m,
            "start": settings.start.tolist(),
            "goal": settings.goal.tolist(),
            "for_each_scene": isinstance(settings.corners, dict),
            "ends_within_m": ENDS_WITHIN_M,
            "min_samples": MIN_SAMPLES,
            "min_scenes": MIN_SCENES,
        }

    def scene(self, name: str) -> dict[str, Any]:
        """Return what stands over a scene's picture [px], and its homography to metres; None for unknown corners."""
        settings = self._settings()
        corners, side = self._corners(name, settings), settings.side_m
        if corners is None:
            return {"name": name, "corners": None, "paths": [], "items": []}
        matrix = _homography(corners, side)

        def pixels(metres: Float[Array, "n 2"]) -> list[list[float]]:
            return np.round(_mapped(np.linalg.inv(matrix), metres), 1).tolist()

        ends = {"start": settings.start, "goal": settings.goal}
        upright = [np.array([[x, 0], [x, side]]) for x in np.linspace(0, side, FIELDS + 1)[1:-1]]
        paths, items = (
            [rows for rows in self.recorded(file) if rows["scene"].iloc[0] == name] for file in (DEMONSTRATIONS, ITEMS)
        )
        return {
            "name": name,
            "corners": corners.tolist(),
            "matrix": matrix.tolist(),
            "grid": [pixels(line) for line in [*upright, *(line[:, ::-1] for line in upright)]],
            "ends": {end: pixels(place[None])[0] for end, place in ends.items()},
            "zones": {end: pixels(outline(np.stack([place] * 2), ENDS_WITHIN_M)) for end, place in ends.items()},
            "paths": [_described(rows) | {"points": pixels(rows[["x", "y"]].to_numpy(float))} for rows in paths],
            "items": [
                {"id": _identity(rows), "kind": rows["kind"].iloc[0], "outline": pixels(_outline(rows))}
                for rows in items
            ],
        }

    def picture(self, scene: str) -> Path:
        """Return the file of a scene's picture; raise InputError if there is none."""
        scenes = self._scenes()
        if scene not in scenes:
            raise InputError(f"there is no picture of scene {scene!r}: reload the page")
        return scenes[scene]

    def picture_size(self, scene: str) -> tuple[int, int]:
        """Return width and height [px] of a scene's picture, upright; InputError if it cannot be read."""
        height, width, _ = self._read(
            self.picture(scene), lambda path: read_picture(path, f"{SCENES}/{path.name}").shape
        )
        return width, height

    @as_sent
    def add_path(self, scene: str, user: str, valid: bool, samples: Samples) -> dict[str, Any]:
        """Store a path and return its demo, id and label; a path that is stored already is not stored twice.

        samples: t [ms], column and row [px]. Raise InputError if they do not lead from start to goal.
        """
        user = tidy_name("person’s name", user)
        with self._lock:
            settings, kept = self._settings(), _thinned(np.array(samples))
            if len(kept) < MIN_SAMPLES:
                raise InputError(
                    f"not stored: the path has {len(kept)} samples, expected {MIN_SAMPLES}; draw it slower"
                )
            metres = self._metres(scene, settings, kept[:, 1:])
            for verb, end, point in (("begins", "start", metres[0]), ("ends", "goal", metres[-1])):
                if (distance := math.dist(getattr(settings, end), point)) > ENDS_WITHIN_M:
                    raise InputError(
                        f"not stored: the path {verb} {100 * distance:.0f} cm from the {end}, expected at most "
                        f"{100 * ENDS_WITHIN_M:.0f} cm; draw it again"
                    )
            if np.maximum(-metres, metres - settings.side_m).max() > MAX_BEYOND_M * settings.side_m:
                raise InputError("not stored: the path goes far off the table; draw it again")
            stored = [rows for rows in self.recorded(DEMONSTRATIONS) if (rows[KEY[:2]] == [scene, user]).all(axis=None)]
            numbers = [int(rows["demo"].iloc[0]) for rows in stored if rows["demo"].iloc[0].isdecimal()]
            demo, word = str(max(numbers, default=0) + 1), "true" if valid else "false"
            samples = np.column_stack([(kept[:, 0] - kept[0, 0]) / 1000, metres]).tolist()
            cells = [(scene, user, demo, f"{t:.3f}", f"{x:.4f}", f"{y:.4f}", word) for t, x, y in samples]
            rows = pd.DataFrame(cells, columns=COLUMNS[DEMONSTRATIONS])
            for path in stored:  # the page sends it again if the first answer got lost
                if path.assign(demo=demo).to_numpy().tolist() == rows.to_numpy().tolist():
                    return _described(path)
            self._write_table(DEMONSTRATIONS, self._table(DEMONSTRATIONS), rows)
            return _described(rows)

    @as_sent
    def add_item(self, scene: str, kind: str, points: Points) -> None:
        """Store an item's footprint; one that is stored already is not stored twice.

        points: centre and rim [px], or both ends and a place on the side. Raise InputError if they outline no item.
        """
        kind = tidy_name("kind", kind)
        with self._lock:
            settings = self._settings()
            metres = self._metres(scene, settings, np.array(points))
            if len(metres) == 2:
                (x, y), angle, radius, half = metres[0], 0.0, math.dist(*metres), 0.0
            else:
                (x, y), along, aside = metres[:2].mean(axis=0), metres[1] - metres[0], metres[2] - metres[0]
                length = max(math.hypot(*along), MIN_RADIUS_M)
                radius = abs(along[0] * aside[1] - along[1] * aside[0]) / length
                angle, half = math.degrees(math.atan2(along[1], along[0])), length / 2 - radius
                if half < 0:
                    raise InputError("the item is wider than long: mark it as a round one")
            if not MIN_RADIUS_M <= radius <= settings.side_m / 2:
                raise InputError(f"the item would have a radius of {100 * radius:.1f} cm: mark it again")
            if not (0 <= x <= settings.side_m and 0 <= y <= settings.side_m):
                raise InputError("the item's centre is not on the table: mark it again")
            row = [scene, kind, f"{x:.4f}", f"{y:.4f}", f"{angle:.1f}", f"{radius:.4f}", f"{half:.4f}"]
            if row not in self._table(ITEMS)[COLUMNS[ITEMS]].to_numpy().tolist():
                self._write_table(ITEMS, self._table(ITEMS), pd.DataFrame([row], columns=COLUMNS[ITEMS]))

    @as_sent
    def remove(self, what: Literal["path", "item"], id: str) -> None:
        """Remove a path or an item; raise InputError if it is not there as the page saw it."""
        name = DEMONSTRATIONS if what == "path" else ITEMS
        with self._lock:
            rows = next((rows for rows in self.recorded(name) if _identity(rows) == id), None)
            if rows is None:
                raise InputError(f"this {what} has been removed already")
            self._write_table(name, self._table(name).drop(rows.index))

    @as_sent
    def place_table(
        self, scene: str, everywhere: bool, corners: Corners | None, side_m: FiniteFloat, start: Point, goal: Point
    ) -> None:
        """Write table.yaml; corners [px] hold in `scene` or `everywhere`, and None leaves them as they are."""
        with self._lock:
            placed = self._settings().corners
            if corners is not None:
                marked = np.array(corners)
                if ((marked < 0) | (marked > self.picture_size(scene))).any():
                    raise InputError("a corner lies outside the picture: mark it again")
                if placed is not None and not isinstance(placed, dict):
                    placed = dict.fromkeys(self._scenes(), placed)
                placed = marked if everywhere else {**(placed or {}), scene: marked}
            where: dict[str, Any] = {"rectified": True}
            if isinstance(placed, dict):
                where = {"corners": {name: places.round(1).tolist() for name, places in placed.items()}}
            elif placed is not None:
                where = {"corners": placed.round(1).tolist()}
            check_settings(values := {"side_m": side_m, **where, "start": start, "goal": goal})
            text = HEADER + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, default_flow_style=None)
            self._write(SETTINGS, lambda part: part.write_text(text, encoding="utf-8"))

    def import_picture(self, file_name: str, content: bytes) -> str:
        """Store a JPEG or PNG as a new scene and return its name, made from the file's.

        Raise InputError if the content is no such picture, is too large or damaged, or the name is taken.
        """
        scene = re.sub(r"[^\w.-]+", "_", Path(normal(file_name).replace("\\", "/")).stem).strip("._-")[:80]
        if not scene:
            raise InputError(f"the file name {file_name!r} has no letter or digit: rename the file")

        def write(part: Path) -> None:
            part.write_bytes(content)
            read_picture(part, file_name)

        ending = ".png" if content.startswith(PNG_SIGNATURE) else ".jpg"
        with self._lock:
            if scene in self._scenes():
                raise InputError(f"there is a scene {scene} already: rename the file, or remove the earlier picture")
            self._write(f"{SCENES}/{scene}{ending}", write)
        return scene

    def recorded(self, name: str) -> list[pd.DataFrame]:
        """Return the rows of each path (the same scene, user and demo), or each item's, in their order."""
        columns = COLUMNS[name]
        groups = self._table(name)[columns].groupby(KEY if name == DEMONSTRATIONS else columns, sort=False)
        return [rows for _, rows in groups]

    def _scenes(self) -> dict[str, Path]:
        """Return the picture of each scene by name; InputError for two of one name or a link outwards."""
        faults = Faults()
        scenes = scene_files(self.folder, faults)
        if scenes and faults:
            raise InputError(faults[0])
        return {scene: self._inside(path) for scene, path in scenes.items()}

    def _settings(self) -> Settings:
        return read_settings(self._inside(self.folder / SETTINGS).parent)

    def _table(self, name: str) -> pd.DataFrame:
        """Return a csv file as text, empty if there is none; InputError for its first fault. Nobody may change it."""

        def read(path: Path) -> pd.DataFrame:
            if read_checked(path, None, faults := Faults()) is None or faults:
                raise InputError(faults[0])
            return read_csv(path, COLUMNS[name])

        path = self._inside(self.folder / name)
        return self._read(path, read) if path.exists() else pd.DataFrame(columns=COLUMNS[name], dtype=str)

    def _read(self, path: Path, read: Callable[[Path], Any]) -> Any:
        """Return what `read` makes of a file, which it reads again only after a change."""
        stat = path.stat()
        state = stat.st_ino, stat.st_size, stat.st_mtime_ns
        known = self._known.get(path)
        if known is None or known[0] != state:
            known = self._known[path] = state, read(path)
        return known[1]

    def _write(self, name: str, write: Callable[[Path], object]) -> None:
        """Replace a file atomically, and return only once it would survive a power cut."""
        path = self._inside(self.folder / name)
        atomic_write(path, lambda part: (write(part), _sync(part)))
        _sync(path.parent)

    def _write_table(self, name: str, *parts: pd.DataFrame) -> None:
        table = pd.concat(parts, ignore_index=True).fillna("")
        self._write(name, lambda part: table.to_csv(part, index=False, lineterminator="\n"))

    def _inside(self, path: Path) -> Path:
        """Return `path`; raise InputError if it leads out of the folder, as a symbolic link can."""
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise InputError(
                f"{path.relative_to(self.folder)} is a link out of the folder: replace it by the file itself"
            )
        return path

    def _corners(self, scene: str, settings: Settings) -> Float[Array, "4 2"] | None:
        """Return the corners [px] of the table in a scene's picture, or None if they are not known."""
        size, corners = self.picture_size(scene), settings.corners_of(scene)
        return whole(*size) if corners is None and settings.rectified and is_square(*size) else corners

    def _metres(self, scene: str, settings: Settings, points: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
        """Return pixels of a scene's picture as metres on the table."""
        corners = self._corners(scene, settings)
        if corners is None:
            raise InputError(f"the table's corners in scene {scene} are not known: mark them first")
        return _mapped(_homography(corners, settings.side_m), points)


def tidy_name(what: str, name: str) -> str:
    """Return a name without needless spaces; raise InputError for one that a csv file should not hold."""
    name = " ".join(normal(name).split())
    if not 1 <= len(name) <= MAX_NAME:
        raise InputError(f"the {what} has {len(name)} characters: expected 1 to {MAX_NAME}")
    if name[0] in FORMULA or not name.isprintable():
        raise InputError(f"the {what} {name!r} would be a formula in a spreadsheet, or cannot be printed: change it")
    return name


def _homography(corners: Float[Array, "4 2"], side_m: float) -> Float[Array, "3 3"]:
    """Return the matrix from a picture's pixels to metres on the table, whose near left corner is (0, 0)."""
    table = side_m * np.array([[0, 1], [1, 1], [1, 0], [0, 0]])
    matrix = cv2.getPerspectiveTransform(corners.astype(np.float32), table.astype(np.float32))
    depth = corners.mean(axis=0) @ matrix[2, :2] + matrix[2, 2]
    return matrix * np.sign(depth)  # depths are positive on this side of the table's horizon


def _mapped(matrix: Float[Array, "3 3"], points: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
    """Return points under a homography; raise InputError for points at or beyond the table's horizon."""
    if (points @ matrix[2, :2] + matrix[2, 2] <= MIN_DEPTH).any():
        raise InputError("a point lies above the horizon of the table: draw on the table")
    return cv2.perspectiveTransform(points[:, None].astype(np.float64), matrix)[:, 0]


def _described(rows: pd.DataFrame) -> dict[str, Any]:
    user, demo, word = rows[["user", "demo", "valid"]].iloc[0]
    return {"id": _identity(rows), "user": user, "demo": demo, "valid": word.lower() == "true"}


def _identity(rows: pd.DataFrame) -> str:
    """Return a name that changes with the content of these rows, so that nobody removes what they have not seen."""
    return hashlib.sha256(repr(rows.to_numpy().tolist()).encode()).hexdigest()[:16]


def _outline(rows: pd.DataFrame) -> Float[Array, "n 2"]:
    """Return the outline [m] of an item."""
    x, y, angle, radius, half = rows[COLUMNS[ITEMS][2:]].to_numpy(float)[0]
    along = half * np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    return outline(np.array([x, y]) + np.stack([-along, along]), radius)


def _thinned(samples: Float[Array, "n 3"]) -> Float[Array, "kept 3"]:
    """Return the first sample in each MIN_STEP_S, and the path's end."""
    _, kept = np.unique((samples[:, 0] - samples[0, 0]) // (1000 * MIN_STEP_S), return_index=True)
    return samples[[*kept[:-1], len(samples) - 1]]


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
