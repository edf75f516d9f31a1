"""Store what is recorded in a folder: every change reads, checks and replaces one file, one change at a time."""

import hashlib
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray as Array

from pipeline.own.csv_files import DEMONSTRATIONS, ITEMS, normal
from pipeline.own.demonstrations import ENDS_WITHIN_M, MIN_SAMPLES, MIN_SCENES
from pipeline.own.pictures import KINDS, is_square, read_picture
from pipeline.own.recorder import files, geometry
from pipeline.own.recorder.files import Row, Table
from pipeline.own.settings import Settings
from pipeline.runtime.errors import InputError
from pipeline.world.hand import MAX_BEYOND_M

COLUMNS = {
    DEMONSTRATIONS: ("scene", "user", "demo", "t", "x", "y", "valid"),
    ITEMS: ("scene", "kind", "x", "y", "angle_deg", "radius_m", "half_length_m"),
}
MIN_STEP_S = 0.008  # between stored samples; some pens report 240 a second
MIN_RADIUS_M = 0.002  # of an item
MAX_NAME = 60  # characters of a person's or a kind's name
FORMULA = "=+-@"  # a spreadsheet runs a cell that begins so


@dataclass(frozen=True)
class View:
    """A scene's picture, and where the table is in it. size: width, height [px]; matrix: pixels to metres."""

    size: tuple[int, int]
    corners: Float[Array, "4 2"]
    matrix: Float[Array, "3 3"]

    def metres(self, points: Float[Array, "n 2"]) -> Float[Array, "n 2"]:
        """Return pixels as metres on the table."""
        return geometry.transform(self.matrix, points)

    def pixels(self, points: Float[Array, "n 2"]) -> list[list[float]]:
        """Return metres on the table as pixels, to a tenth."""
        return np.round(geometry.transform(np.linalg.inv(self.matrix), points), 1).tolist()


class Recordings:
    """The scenes, paths, items and the table of one folder. Its methods may be called from several threads."""

    def __init__(self, folder: Path) -> None:
        """Open a folder; raise InputError if what it holds cannot be read."""
        self.folder = folder
        self._lock = RLock()
        self._read: dict[str, tuple[tuple[int, ...], Table]] = {}  # tables by file name, and the files' states then
        self.overview()

    def overview(self) -> dict[str, Any]:
        """Return scenes, users, kinds, the number of paths and items, and start and goal."""
        with self._lock:
            scenes, settings = files.list_scenes(self.folder), files.read_table_place(self.folder)
            paths, items = _by_path(self._rows(DEMONSTRATIONS)), self._rows(ITEMS)
            counts: dict[str, dict[str, dict[str, int]]] = {scene: {} for scene in scenes}
            for rows in paths:
                first = rows[0]
                count = counts.setdefault(first["scene"], {}).setdefault(first["user"], {"valid": 0, "invalid": 0})
                count["valid" if _is_true(first["valid"]) else "invalid"] += 1
            kinds = {normal(path.name) for path in (self.folder / KINDS).glob("*") if path.is_dir()}
            return {
                "folder": self.folder.resolve().name,
                "scenes": list(scenes),
                "users": list(dict.fromkeys(rows[0]["user"] for rows in paths)),
                "counts": counts,
                "items": {scene: sum(row["scene"] == scene for row in items) for scene in scenes},
                "kinds": sorted(kinds | {row["kind"] for row in items}),
                "table": {
                    "side_m": settings.side_m,
                    "start": settings.start.tolist(),
                    "goal": settings.goal.tolist(),
                    "for_each_scene": isinstance(settings.corners, dict),
                },
                "ends_within_m": ENDS_WITHIN_M,
                "min_samples": MIN_SAMPLES,
                "min_scenes": MIN_SCENES,
            }

    def scene(self, name: str) -> dict[str, Any]:
        """Return what stands over a scene's picture [px], and its homography to metres; None for unknown corners."""
        with self._lock:
            settings = files.read_table_place(self.folder)
            view = self._view(name, settings)
            if view is None:
                return {"name": name, "corners": None, "paths": [], "items": []}
            ends = {"start": settings.start, "goal": settings.goal}
            paths = _by_path(row for row in self._rows(DEMONSTRATIONS) if row["scene"] == name)
            items = [row for row in self._rows(ITEMS) if row["scene"] == name]
            return {
                "name": name,
                "corners": view.corners.tolist(),
                "matrix": view.matrix.tolist(),
                "grid": [view.pixels(line) for line in geometry.grid(settings.side_m)],
                "ends": {end: view.pixels(place[None])[0] for end, place in ends.items()},
                "zones": {end: view.pixels(geometry.capsule(place, ENDS_WITHIN_M)) for end, place in ends.items()},
                "paths": [_described(rows) | {"points": view.pixels(_numbers(rows, "x", "y"))} for rows in paths],
                "items": [
                    {"id": _identity([row]), "kind": row["kind"], "outline": view.pixels(_outline(row))}
                    for row in items
                ],
            }

    def picture(self, scene: str) -> Path:
        """Return the file of a scene's picture; raise InputError if there is none."""
        scenes = files.list_scenes(self.folder)
        if scene not in scenes:
            raise InputError(f"there is no picture of scene {scene!r}: reload the page")
        return scenes[scene]

    def add_path(self, scene: str, user: str, valid: bool, samples: Float[Array, "n 3"]) -> dict[str, Any]:
        """Store a path and return its demo, id and label; a path that is stored already is not stored twice.

        samples: t [ms], column and row [px]. Raise InputError if they do not lead from start to goal.
        """
        user = tidy_name("person’s name", user)
        with self._lock:
            rows = [
                {"t": f"{t:.3f}", "x": f"{x:.4f}", "y": f"{y:.4f}", "scene": scene, "user": user}
                for t, x, y in self._measured(scene, samples)
            ]
            word = {"valid": "true" if valid else "false"}
            rows = [row | word for row in rows]
            stored = _by_path(r for r in self._rows(DEMONSTRATIONS) if r["scene"] == scene and r["user"] == user)
            for path in stored:  # the page sends it again if the first answer got lost
                if [{column: row[column] for column in rows[0]} for row in path] == rows:
                    return _described(path)
            last = max((int(path[0]["demo"]) for path in stored if path[0]["demo"].isdecimal()), default=0)
            rows = [row | {"demo": str(last + 1)} for row in rows]
            self._replace(DEMONSTRATIONS, [*self._rows(DEMONSTRATIONS), *rows])
            return _described(rows)

    def remove_path(self, identity: str) -> None:
        """Remove a path; raise InputError if it is not there as the page saw it."""
        with self._lock:
            paths = _by_path(self._rows(DEMONSTRATIONS))
            removed = {id(row) for rows in paths if _identity(rows) == identity for row in rows}
            if not removed:
                raise InputError("this path has been removed already")
            self._replace(DEMONSTRATIONS, [row for row in self._rows(DEMONSTRATIONS) if id(row) not in removed])

    def add_item(self, scene: str, kind: str, points: Float[Array, "n 2"]) -> None:
        """Store an item's footprint.

        points: centre and rim [px], or both ends and a place on the side. Raise InputError if they outline no item.
        """
        kind = tidy_name("kind", kind)
        with self._lock:
            x, y, angle, radius, half = self._footprint(scene, points)
            row = {"scene": scene, "kind": kind, "x": f"{x:.4f}", "y": f"{y:.4f}", "angle_deg": f"{angle:.1f}"}
            row |= {"radius_m": f"{radius:.4f}", "half_length_m": f"{half:.4f}"}
            if _identity([row]) not in {_identity([other]) for other in self._rows(ITEMS)}:
                self._replace(ITEMS, [*self._rows(ITEMS), row])

    def remove_item(self, identity: str) -> None:
        """Remove an item; raise InputError if it is not there as the page saw it."""
        with self._lock:
            kept = [row for row in self._rows(ITEMS) if _identity([row]) != identity]
            if len(kept) == len(self._rows(ITEMS)):
                raise InputError("this item has been removed already")
            self._replace(ITEMS, kept)

    def place_table(
        self,
        scene: str,
        everywhere: bool,
        corners: Float[Array, "4 2"] | None,
        side_m: float,
        start: Sequence[float],
        goal: Sequence[float],
    ) -> None:
        """Write table.yaml; corners [px] hold in `scene` or `everywhere`, and None leaves them as they are."""
        with self._lock:
            settings, size = files.read_table_place(self.folder), self._size(scene)
            shared = settings.corners
            if corners is not None:
                if ((corners < 0) | (corners > size)).any():
                    raise InputError("a corner lies outside the picture: mark it again")
                each = shared if isinstance(shared, dict) else {}
                if not isinstance(shared, dict) and shared is not None:
                    each = dict.fromkeys(files.list_scenes(self.folder), shared)
                shared = corners if everywhere else {**each, scene: corners}
            values: dict[str, Any] = {"side_m": side_m}
            if isinstance(shared, dict):
                values["corners"] = {name: _rounded(places) for name, places in shared.items()}
            elif shared is not None:
                values["corners"] = _rounded(shared)
            else:
                values["rectified"] = True
            files.write_table_place(self.folder, values | {"start": list(start), "goal": list(goal)})

    def import_picture(self, file_name: str, content: bytes) -> str:
        """Store a picture as a new scene and return its name."""
        with self._lock:
            return files.import_picture(self.folder, file_name, content)

    def _rows(self, name: str) -> list[Row]:
        return self._table(name).rows

    def _table(self, name: str) -> Table:
        """Return a csv file's table, read again if the file has changed."""
        path = files.inside(self.folder, self.folder / name)
        state = _state(path)
        if name not in self._read or self._read[name][0] != state:
            self._read[name] = state, files.read_table(path, COLUMNS[name])
        return self._read[name][1]

    def _replace(self, name: str, rows: list[Row]) -> None:
        table = Table(self._table(name).columns, rows)
        files.write_table(self.folder / name, table)
        self._read[name] = _state(self.folder / name), table

    def _size(self, scene: str) -> tuple[int, int]:
        """Return width and height [px] of a scene's picture, upright."""
        path = self.picture(scene)
        return _picture_size(path, _state(path))

    def _view(self, scene: str, settings: Settings) -> View | None:
        """Return where the table is in a scene's picture, or None if its corners are not known."""
        width, height = self._size(scene)
        corners = settings.corners_of(scene)
        if corners is None and settings.rectified and is_square(width, height):
            corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
        if corners is None:
            return None
        return View((width, height), corners, geometry.homography(corners, settings.side_m))

    def _known_view(self, scene: str) -> tuple[View, Settings]:
        settings = files.read_table_place(self.folder)
        view = self._view(scene, settings)
        if view is None:
            raise InputError(f"the table's corners in scene {scene} are not known: mark them first")
        return view, settings

    def _measured(self, scene: str, samples: Float[Array, "n 3"]) -> Float[Array, "kept 3"]:
        """Return a path's samples as t [s] from 0, x and y [m]; raise InputError if it is none from start to goal."""
        view, settings = self._known_view(scene)
        samples = _thinned(samples)
        if len(samples) < MIN_SAMPLES:
            raise InputError(f"not stored: the path has {len(samples)} samples, expected {MIN_SAMPLES}; draw it slower")
        metres = view.metres(samples[:, 1:])
        ends = (("begins", "start", settings.start, metres[0]), ("ends", "goal", settings.goal, metres[-1]))
        for verb, end, place, point in ends:
            if (distance := math.dist(place, point)) > ENDS_WITHIN_M:
                raise InputError(
                    f"not stored: the path {verb} {100 * distance:.0f} cm from the {end}, expected at most "
                    f"{100 * ENDS_WITHIN_M:.0f} cm; draw it again"
                )
        if np.maximum(-metres, metres - settings.side_m).max() > MAX_BEYOND_M * settings.side_m:
            raise InputError("not stored: the path goes far off the table; draw it again")
        return np.column_stack([(samples[:, 0] - samples[0, 0]) / 1000, metres])

    def _footprint(self, scene: str, points: Float[Array, "n 2"]) -> tuple[float, float, float, float, float]:
        """Return x, y [m], angle [deg], radius and half-length [m] of the capsule that the points mark."""
        view, settings = self._known_view(scene)
        metres = view.metres(points)
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
        return float(x), float(y), angle, radius, half


def tidy_name(what: str, name: str) -> str:
    """Return a name without needless spaces; raise InputError for one that a csv file should not hold."""
    name = " ".join(normal(name).split())
    if not 1 <= len(name) <= MAX_NAME:
        raise InputError(f"the {what} has {len(name)} characters: expected 1 to {MAX_NAME}")
    if name[0] in FORMULA or not name.isprintable():
        raise InputError(f"the {what} {name!r} would be a formula in a spreadsheet, or cannot be printed: change it")
    return name


def _by_path(rows: Iterable[Row]) -> list[list[Row]]:
    """Return the rows of each path, in the order in which the paths begin."""
    paths: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        paths.setdefault((row["scene"], row["user"], row["demo"]), []).append(row)
    return list(paths.values())


def _described(rows: list[Row]) -> dict[str, Any]:
    first = rows[0]
    return {"id": _identity(rows), "user": first["user"], "demo": first["demo"], "valid": _is_true(first["valid"])}


def _identity(rows: list[Row]) -> str:
    """Return a name that changes with the content of these rows, so that nobody removes what they have not seen."""
    known = {*COLUMNS[DEMONSTRATIONS], *COLUMNS[ITEMS]}
    content = [sorted((column, text) for column, text in row.items() if column in known) for row in rows]
    return hashlib.sha256(repr(content).encode()).hexdigest()[:16]


def _outline(row: Row) -> Float[Array, "n 2"]:
    """Return the outline [m] of an item."""
    ((x, y, angle, radius, half),) = _numbers([row], *COLUMNS[ITEMS][2:])
    return geometry.capsule(np.array([x, y]), radius, half, angle)


def _numbers(rows: list[Row], *columns: str) -> Float[Array, "row column"]:
    try:
        return np.array([[float(row[column]) for column in columns] for row in rows])
    except ValueError as error:
        raise InputError(
            f"scene {rows[0]['scene']}: a csv file holds no number where one is needed ({error})"
        ) from error


def _is_true(word: str) -> bool:
    if word.lower() not in ("true", "false"):
        raise InputError(f"{DEMONSTRATIONS}: valid is {word!r}: expected true or false")
    return word.lower() == "true"


def _thinned(samples: Float[Array, "n 3"]) -> Float[Array, "kept 3"]:
    """Return samples at least `MIN_STEP_S` apart; the path's end stays."""
    kept = [0]
    for index, t in enumerate(samples[:, 0]):
        if t - samples[kept[-1], 0] >= 1000 * MIN_STEP_S:
            kept.append(index)
    if len(kept) > 1 and samples[-1, 0] >= samples[kept[-1], 0]:
        kept[-1] = len(samples) - 1
    return samples[kept]


def _rounded(corners: Float[Array, "4 2"]) -> list[list[float]]:
    return np.round(corners, 1).tolist()


def _state(path: Path) -> tuple[int, ...]:
    """Return what changes when a file is replaced or edited."""
    if not path.exists():
        return ()
    stat = path.stat()
    return stat.st_ino, stat.st_size, stat.st_mtime_ns


@lru_cache(maxsize=1000)
def _picture_size(path: Path, state: tuple[int, ...]) -> tuple[int, int]:
    """Return width and height [px] of a picture in this state, upright."""
    try:
        height, width = read_picture(path).shape[:2]
    except InputError as error:
        raise InputError(f"{path.parent.name}/{path.name} {error}") from error
    return width, height
