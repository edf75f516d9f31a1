"""The folder that is recorded into: every change is one read, one check and one replaced file, under one lock."""

import hashlib
import math
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from threading import RLock
from typing import Any

import numpy as np
from jaxtyping import Float

from pipeline.own.recorder import geometry, pictures
from pipeline.own.recorder.table_top import ENDS_WITHIN_M, TableTop, read_table_top, write_table_top
from pipeline.own.recorder.tables import Table, read_table, write_table
from pipeline.runtime.errors import InputError

DEMONSTRATIONS = ("scene", "user", "demo", "t", "x", "y", "valid")
ITEMS = ("scene", "kind", "x", "y", "angle_deg", "radius_m", "half_length_m")
TRUE, FALSE = ("true", "1", "yes"), ("false", "0", "no")
MIN_SAMPLES = 3
MIN_STEP_S = 0.008  # between two stored samples; pens report up to 240 a second
MIN_ITEM_M, MAX_ITEM_SHARE = 0.002, 0.5  # radius of an item: from 2 mm to half the table
Row = dict[str, str]


@dataclass(frozen=True)
class Placed:
    """A scene's picture and the homographies between it and the table."""

    size: tuple[int, int]
    to_metres: Float[np.ndarray, "3 3"]

    def metres(self, points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Return pixels as metres on the table."""
        return geometry.transform(self.to_metres, points)

    def pixels(self, points: Float[np.ndarray, "n 2"]) -> list[list[float]]:
        """Return metres on the table as pixels, rounded to a tenth."""
        inverse = np.linalg.inv(self.to_metres)
        return np.round(geometry.transform(inverse / inverse[2, 2], points), 1).tolist()


class Recordings:
    """The scenes, paths, items and table of one folder."""

    def __init__(self, folder: Path) -> None:
        """Open a folder; raise InputError if what it holds cannot be added to."""
        self.folder = folder
        self._lock = RLock()
        self.overview()

    def overview(self) -> dict[str, Any]:
        """Return what is recorded: scenes, users, kinds, counts for each scene and user, and the table."""
        with self._lock:
            scenes, table = pictures.list_scenes(self.folder), read_table_top(self.folder)
            counts: dict[str, dict[str, dict[str, int]]] = {scene: {} for scene in scenes}
            users: list[str] = []
            for rows in _paths(self._demonstrations().rows):
                first = rows[0]
                users += [first["user"]] * (first["user"] not in users)
                count = counts.setdefault(first["scene"], {}).setdefault(first["user"], {"valid": 0, "invalid": 0})
                count["valid" if _truth(first["valid"]) else "invalid"] += 1
            items = self._items().rows
            return {
                "folder": self.folder.resolve().name,
                "scenes": list(scenes),
                "users": users,
                "counts": counts,
                "items": {scene: sum(row["scene"] == scene for row in items) for scene in scenes},
                "kinds": sorted({row["kind"] for row in items} | _subfolders(self.folder / "kinds")),
                "table": {"side_m": table.side_m, "start": table.start, "goal": table.goal},
                "corners_for_each_scene": bool(table.corners),
                "ends_within_m": ENDS_WITHIN_M,
                "max_upload_bytes": pictures.MAX_UPLOAD_BYTES,
            }

    def scene(self, name: str) -> dict[str, Any]:
        """Return what is drawn over a scene's picture [px], and the homography to metres; None where no corners are."""
        with self._lock:
            path, table = self.picture(name), read_table_top(self.folder)
            size = pictures.picture_size(path)
            described: dict[str, Any] = {"name": name, "size": size, "corners": None, "paths": [], "items": []}
            if (placed := self._placed(name, table)) is None:
                return described
            places = {"start": np.array(table.start), "goal": np.array(table.goal)}
            corners = table.corners_in(name, size)
            described["corners"] = None if corners is None else corners.tolist()
            described["to_metres"] = placed.to_metres.tolist()
            described["places"] = {end: placed.pixels(place[None])[0] for end, place in places.items()}
            described["zones"] = {
                end: placed.pixels(geometry.circle(place, ENDS_WITHIN_M)) for end, place in places.items()
            }
            described["grid"] = [placed.pixels(line) for line in _grid(table.side_m)]
            for rows in _paths(row for row in self._demonstrations().rows if row["scene"] == name):
                points = np.array([[_number(row, "x"), _number(row, "y")] for row in rows])
                described["paths"].append(
                    {
                        "id": _identity(rows),
                        "user": rows[0]["user"],
                        "demo": rows[0]["demo"],
                        "valid": _truth(rows[0]["valid"]),
                        "points": placed.pixels(points),
                    }
                )
            for row in (row for row in self._items().rows if row["scene"] == name):
                x, y, angle, radius, half = (_number(row, column) for column in ITEMS[2:])
                outline = geometry.capsule(np.array([x, y]), angle, radius, half)
                described["items"].append(
                    {"id": _identity([row]), "kind": row["kind"], "outline": placed.pixels(outline)}
                )
            return described

    def picture(self, name: str) -> Path:
        """Return the file of a scene's picture; raise InputError if there is no such scene."""
        scenes = pictures.list_scenes(self.folder)
        if name not in scenes:
            raise InputError(f"there is no scene {name!r} in scenes/: reload the page")
        return scenes[name]

    def add_path(self, scene: str, user: str, valid: bool, samples: Float[np.ndarray, "n 3"]) -> dict[str, str]:
        """Store a path and return its demo and id; a path that is stored already is not stored again.

        `samples` are t [ms], column and row [px]. Raise InputError if the path does not lead from start to goal.
        """
        user = cell("user", user)
        with self._lock:
            table, path = self._demonstrations(), self._path()
            values = self._to_metres(scene, samples)
            rows = [
                {"scene": scene, "user": user, "t": f"{t:.3f}", "x": f"{x:.4f}", "y": f"{y:.4f}"} for t, x, y in values
            ]
            for row in rows:
                row["valid"] = "true" if valid else "false"
            taken = {r["demo"]: r for r in table.rows if r["scene"] == scene and r["user"] == user}
            for stored in _paths(row for row in table.rows if row["scene"] == scene and row["user"] == user):
                if [{column: row[column] for column in rows[0]} for row in stored] == rows:
                    return {"demo": stored[0]["demo"], "id": _identity(stored)}  # sent again after a lost answer
            demo = str(1 + max((int(name) for name in taken if name.isdecimal()), default=0))
            for row in rows:
                row["demo"] = demo
            table.rows += rows
            write_table(path, table)
            return {"demo": demo, "id": _identity(rows)}

    def remove_path(self, identity: str) -> None:
        """Remove a path; raise InputError if it is not there (any more)."""
        with self._lock:
            table = self._demonstrations()
            removed = next((rows for rows in _paths(table.rows) if _identity(rows) == identity), None)
            if removed is None:
                raise InputError("this path is gone already: somebody removed it")
            table.rows = [row for row in table.rows if not any(row is other for other in removed)]
            write_table(self._path(), table)

    def add_item(self, scene: str, kind: str, points: Float[np.ndarray, "n 2"]) -> dict[str, str]:
        """Store an item's footprint and return its id.

        `points` [px] are the centre and a place on the rim of a round item, or both ends and a place on the side of a
        long one. Raise InputError if they describe no item on the table.
        """
        kind = cell("kind", kind)
        with self._lock:
            x, y, angle, radius, half = self._capsule(scene, points)
            row = {"scene": scene, "kind": kind, "x": f"{x:.4f}", "y": f"{y:.4f}", "angle_deg": f"{angle:.1f}"}
            row |= {"radius_m": f"{radius:.4f}", "half_length_m": f"{half:.4f}"}
            table = self._items()
            if row not in [{column: other[column] for column in ITEMS} for other in table.rows]:
                table.rows.append(row)
                write_table(self._path("items.csv"), table)
            return {"id": _identity([row])}

    def remove_item(self, identity: str) -> None:
        """Remove an item; raise InputError if it is not there (any more)."""
        with self._lock:
            table = self._items()
            kept = [row for row in table.rows if _identity([row]) != identity]
            if len(kept) == len(table.rows):
                raise InputError("this item is gone already: somebody removed it")
            table.rows = kept
            write_table(self._path("items.csv"), table)

    def set_table(
        self, scene: str | None, corners: list[list[float]] | None, side_m: float, ends: dict[str, list[float]]
    ) -> None:
        """Write table.yaml; `corners` [px] hold for `scene`, or for every scene if that is None."""
        with self._lock:
            if scene is not None:
                self.picture(scene)
            write_table_top(self.folder, scene, corners, side_m, ends)

    def add_picture(self, file_name: str, content: bytes) -> str:
        """Store a picture as a new scene and return its name."""
        with self._lock:
            return pictures.import_picture(self.folder, file_name, content)

    def _path(self, name: str = "demonstrations.csv") -> Path:
        return pictures.inside(self.folder, self.folder / name)

    def _demonstrations(self) -> Table:
        return read_table(self._path(), DEMONSTRATIONS)

    def _items(self) -> Table:
        return read_table(self._path("items.csv"), ITEMS)

    def _placed(self, scene: str, table: TableTop) -> Placed | None:
        """Return the homography of a scene's picture, or None if the table's corners are not known."""
        size = pictures.picture_size(self.picture(scene))
        corners = table.corners_in(scene, size)
        return None if corners is None else Placed(size, geometry.to_metres(corners, table.side_m))

    def _located(self, scene: str) -> tuple[Placed, TableTop]:
        table = read_table_top(self.folder)
        placed = self._placed(scene, table)
        if placed is None:
            raise InputError(f"the table's corners in scene {scene} are not known: mark them first, under Table")
        return placed, table

    def _to_metres(self, scene: str, samples: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Return samples as t [s] from 0, x and y [m]; raise InputError if they are no path from start to goal."""
        placed, table = self._located(scene)
        samples = _thinned(samples)
        if len(samples) < MIN_SAMPLES:
            raise InputError(f"the path has {len(samples)} samples, at least {MIN_SAMPLES} are needed: draw it slower")
        metres = placed.metres(samples[:, 1:])
        for end, place, point in (("start", table.start, metres[0]), ("goal", table.goal, metres[-1])):
            distance = math.dist(place, point)
            if distance > ENDS_WITHIN_M:
                word = "begins" if end == "start" else "ends"
                raise InputError(
                    f"not stored: the path {word} {100 * distance:.0f} cm from the {end}, "
                    f"at most {100 * ENDS_WITHIN_M:.0f} cm are allowed; draw it again"
                )
        return np.column_stack([(samples[:, 0] - samples[0, 0]) / 1000, metres])

    def _capsule(self, scene: str, points: Float[np.ndarray, "n 2"]) -> tuple[float, float, float, float, float]:
        """Return centre x, y [m], angle [deg], radius and half-length [m] of the item that the points mark."""
        placed, table = self._located(scene)
        metres = placed.metres(points)
        angle = half = 0.0
        if len(metres) == 2:
            centre = metres[0]
            radius = math.dist(*metres)
        else:
            centre, along = metres[:2].mean(axis=0), metres[1] - metres[0]
            length = max(float(np.hypot(*along)), 1e-9)
            aside = metres[2] - metres[0]
            radius = abs(along[0] * aside[1] - along[1] * aside[0]) / length
            angle = math.degrees(math.atan2(along[1], along[0]))
            half = length / 2 - radius
            if half < 0:
                raise InputError("the item is wider than long: mark it as a round one")
        if not MIN_ITEM_M <= radius <= MAX_ITEM_SHARE * table.side_m:
            raise InputError(f"the item's radius would be {100 * radius:.1f} cm: mark it again")
        if not ((centre >= 0) & (centre <= table.side_m)).all():
            raise InputError("the item's centre is not on the table: mark it again")
        return float(centre[0]), float(centre[1]), angle, radius, half


def cell(what: str, name: str) -> str:
    """Return a person's or a kind's name, tidied; raise InputError if a spreadsheet could take it for a formula."""
    name = " ".join(unicodedata.normalize("NFC", name).split())
    if not 1 <= len(name) <= 60:
        raise InputError(f"the {what} has {len(name)} characters: expected 1 to 60")
    if name[0] in "=+-@" or not name.isprintable():
        raise InputError(f"the {what} {name!r} begins with one of = + - @ or holds control characters: choose another")
    return name


def _paths(rows: Iterable[Row]) -> list[list[Row]]:
    """Return the rows of each path, in the order in which paths begin in the file."""
    paths: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        paths.setdefault((row["scene"], row["user"], row["demo"]), []).append(row)
    return list(paths.values())


def _thinned(samples: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Return the samples at least `MIN_STEP_S` apart, the last one included."""
    kept: list[int] = []
    for index, t in enumerate(samples[:, 0]):
        if not kept or t - samples[kept[-1], 0] >= 1000 * MIN_STEP_S:
            kept.append(index)
    if kept and kept[-1] != len(samples) - 1 and samples[-1, 0] >= samples[kept[-1], 0] and len(kept) > 1:
        kept[-1] = len(samples) - 1
    return samples[kept]


def _grid(side_m: float) -> list[Float[np.ndarray, "2 2"]]:
    """Return the ends [m] of lines that divide the table into ten fields a side."""
    tenths = np.linspace(0, side_m, 11)[1:-1]
    lines = [np.array([[at, 0], [at, side_m]]) for at in tenths]
    return lines + [line[:, ::-1] for line in lines]


def _truth(word: str) -> bool:
    """Return the value of a cell in column valid."""
    if word.strip().lower() not in TRUE + FALSE:
        raise InputError(f"demonstrations.csv: valid is {word!r}: expected true or false")
    return word.strip().lower() in TRUE


def _number(row: Row, column: str) -> float:
    try:
        return float(row[column])
    except ValueError as error:
        raise InputError(
            f"scene {row['scene']}: {column} is {row[column]!r}, no number: correct the csv file"
        ) from error


def _identity(rows: list[Row]) -> str:
    """Return a name for these rows that changes with their content: nobody removes what they have not seen."""
    known = {*DEMONSTRATIONS, *ITEMS}
    text = repr([sorted(cell for cell in row.items() if cell[0] in known) for row in rows])
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _subfolders(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("*") if path.is_dir()}
