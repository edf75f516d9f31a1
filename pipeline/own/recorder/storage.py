"""Store what is recorded in a folder: every change reads, checks and replaces one file, one change at a time."""

import hashlib
import json
import os
from collections.abc import Callable
from pathlib import Path
from threading import Lock
from typing import Annotated, Any

import numpy as np
import pandas as pd
import yaml
from jaxtyping import Float
from numpy import ndarray as Array
from pydantic import ConfigDict, Field, FiniteFloat, validate_call

from pipeline.own import files
from pipeline.own.demonstrations import MIN_SAMPLES, MIN_SCENES, check_paths, thinned
from pipeline.own.files import DEMONSTRATIONS, KEY, SETTINGS, Faults, Settings, is_printable, normal
from pipeline.own.frame import mapped, rectify, to_metres, whole
from pipeline.own.items import COCO, OUTSIDE, Told, crosses_itself
from pipeline.own.pictures import read_picture
from pipeline.own.recorder.outlines import Item, from_coco, propose, replaced, told_elsewhere
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

HEADER = "# Where the table is in the pictures, written by the recorder. docs/own-tables.md says what each line is.\n"
COLUMNS = files.COLUMNS[DEMONSTRATIONS]
FIELDS = 10  # of the grid over the table, a side
MIN_STEP_MS = 8.0  # between stored samples; some pens report 240 a second
MAX_NAME = 60  # characters

Point = Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]
Corners = Annotated[list[Point], Field(min_length=4, max_length=4)]
Sample = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
Samples = Annotated[list[Sample], Field(min_length=1, max_length=100_000)]
Outlined = Annotated[list[Point], Field(min_length=3, max_length=20_000)]  # a mask's has thousands
as_sent = validate_call(config=ConfigDict(strict=True))  # checks what a page sends as the arguments of a method


class Recordings:
    """The scenes, paths and the table of one folder. Its methods may be called from several threads."""

    def __init__(self, folder: Path) -> None:
        """Open a folder; raise InputError if what it holds cannot be read."""
        self.folder = folder
        self._lock = Lock()  # held by each change
        self._known: dict[Path, tuple[tuple[int, ...], Any]] = {}  # state of each file that was read, and its content
        self.overview()

    def overview(self) -> dict[str, Any]:
        """Return scenes, users, the numbers of paths, and the table's size."""
        scenes, settings = list(self._scenes()), self._settings()
        paths = self._table().drop_duplicates(KEY)
        counts: dict[str, dict[str, dict[str, int]]] = {scene: {} for scene in scenes}
        for scene, user, word in zip(paths["scene"], paths["user"], paths["valid"], strict=True):
            count = counts.setdefault(scene, {}).setdefault(user, {"valid": 0, "invalid": 0, "unjudged": 0})
            count[{"true": "valid", "": "unjudged"}.get(word.lower(), "invalid")] += 1
        return {
            "folder": self.folder.resolve().name,
            "scenes": scenes,
            "users": list(dict.fromkeys(paths["user"])),
            "counts": counts,
            "size_m": settings.size_m.tolist(),
            "for_each_scene": isinstance(settings.corners, dict),
            "min_samples": MIN_SAMPLES,
            "min_scenes": MIN_SCENES,
        }

    def scene(self, name: str) -> dict[str, Any]:
        """Return what stands over a scene's picture [px]; None for unknown corners."""
        settings = self._settings()
        corners, size = self._corners(name, settings), settings.size_m
        if corners is None:
            return {"name": name, "corners": None, "paths": []}
        back = np.linalg.inv(to_metres(corners, size))

        def pixels(metres: Float[Array, "n 2"]) -> list[list[float]]:
            return np.round(mapped(back, metres), 1).tolist()

        shares = np.linspace(0, 1, FIELDS + 1)[1:-1]
        upright = [np.array([[x, 0], [x, 1]]) for x in shares]
        paths = [rows for rows in self.recorded() if rows["scene"].iloc[0] == name]
        return {
            "name": name,
            "corners": corners.tolist(),
            "grid": [pixels(line * size) for line in [*upright, *(line[:, ::-1] for line in upright)]],
            "paths": [described(rows) | {"points": pixels(rows[["x", "y"]].to_numpy(float))} for rows in paths],
        }

    def picture(self, scene: str) -> Path:
        """Return the file of a scene's picture; raise InputError if there is none."""
        scenes = self._scenes()
        if scene not in scenes:
            raise InputError(f"there is no picture of scene {scene!r}: reload the page")
        return scenes[scene]

    def picture_size(self, scene: str) -> tuple[int, int]:
        """Return width and height [px] of a scene's picture, upright; InputError if it cannot be read."""
        height, width, _ = self._read(self.picture(scene), lambda path: read_picture(path, path.name).shape)
        return width, height

    @as_sent
    def add_path(self, scene: str, user: str, valid: bool, samples: Samples) -> dict[str, Any]:
        """Store a path and return its demo, id and label; a path that is stored already is not stored twice.

        samples: t [ms], column and row [px]. Raise InputError if no hand moves so.
        """
        user = tidy_name(user)
        with self._lock:
            settings, kept = self._settings(), np.array(samples)
            kept = kept[thinned(kept[:, 0], MIN_STEP_MS)]
            corners, t = self._corners(scene, settings), (kept[:, 0] - kept[0, 0]) / 1000
            if corners is None:
                raise InputError(f"the table's corners in scene {scene} are not known: mark them first")
            metres = mapped(to_metres(corners, settings.size_m), kept[:, 1:])
            stored = [rows for rows in self.recorded() if (rows[KEY[:2]] == [scene, user]).all(axis=None)]
            numbers = [int(rows["demo"].iloc[0]) for rows in stored if rows["demo"].iloc[0].isdecimal()]
            demo, word = str(max(numbers, default=0) + 1), "true" if valid else "false"
            rows = pd.DataFrame(dict(zip(COLUMNS, (scene, user, demo, t, *metres.T, word), strict=True)))
            rows["t"] = rows["t"].map("{:.3f}".format)
            rows[["x", "y"]] = rows[["x", "y"]].map("{:.4f}".format)
            read = rows.astype({"t": float, "x": float, "y": float}).assign(name=f"{scene}, {user}, {demo}")
            check_paths(read, settings, faults := Faults())
            if faults:
                raise InputError(f"not stored: {faults[0].partition(': ')[2]}; draw it again")
            for path in stored:  # the page sends it again if the first answer got lost
                if path.assign(demo=demo).to_numpy().tolist() == rows.to_numpy().tolist():
                    return described(path)
            self._write_paths(self._table(), rows)
            return described(rows)

    @as_sent
    def judge(self, id: str, valid: bool) -> None:
        """Label a stored path that nobody judged; raise InputError if it is not there as the page saw it."""
        with self._lock:
            table = self._table().copy()
            table.loc[self._path(id).index, "valid"] = "true" if valid else "false"
            self._write_paths(table)

    @as_sent
    def remove(self, id: str) -> None:
        """Remove a path; raise InputError if it is not there as the page saw it."""
        with self._lock:
            self._write_paths(self._table().drop(self._path(id).index))

    def items(self, scene: str) -> dict[str, Any]:
        """Return the stored items of a scene, whether it is told what stands there, and all kinds that are named."""
        stored = self._coco()[1]
        kinds = sorted({item.kind for items in stored.values() for item in items if item.kind})
        told = {"told": scene in stored, "elsewhere": told_elsewhere(self.folder, scene)}
        return {"items": [item._asdict() for item in stored.get(scene, [])], "kinds": kinds, **told}

    @as_sent
    def propose(self, scene: str, point: Point, edge: Point) -> dict[str, Any]:
        """Return the outline of what is at a point of a scene's picture; edge: where it ends, or the point again."""
        path = self.picture(scene)
        return {"points": propose(read_picture(path, path.name), point, edge)}

    @as_sent
    def place_items(self, scene: str, kinds: list[str], outlines: list[Outlined], told: bool = True) -> None:
        """Replace the items of a scene; outlines [column, row] of its picture; kinds: "" where nobody names one.

        told: a scene without items is told to be empty; else it is left to the detector again.
        """
        if elsewhere := told_elsewhere(self.folder, scene):
            raise InputError(f"items of {scene} stand in {elsewhere}: change them there")
        size = np.array(self.picture_size(scene))
        for points in map(np.array, outlines):
            if crosses_itself(points):
                raise InputError("an outline crosses itself: drag its points apart")
            if (points < -OUTSIDE * size).any() or (points > (1 + OUTSIDE) * size).any():
                raise InputError("an outline leaves the picture: drag it back")
        with self._lock:
            named = [tidy_name(kind) if kind else "" for kind in kinds]
            items = [Item(kind, points) for kind, points in zip(named, outlines, strict=True)]
            coco = replaced(self._coco()[0], self.picture(scene).name, tuple(size.tolist()), items if told else None)
            write_durably(self.folder / COCO, json.dumps(coco, ensure_ascii=False, indent=1) + "\n")

    def found(self, scene: str) -> dict[str, Any]:
        """Return the outlines that the detector finds in a scene's picture, each with the most alike named kind."""
        from pipeline.own.seen import suggest  # torch takes seconds to import, and only this needs it

        settings, stored = self._settings(), self._coco()[1]
        told, pictures, matrices = {}, {}, {}
        for name in {scene, *(stored.keys() & self._scenes())}:
            corners, path = self._corners(name, settings), self.picture(name)
            if corners is not None:
                pictures[name] = rectify(read_picture(path, path.name), corners, settings.size_m)
                matrix = matrices[name] = to_metres(corners, settings.size_m / settings.size_m.max())
                items = stored.get(name, [])
                told[name] = [Told(item.kind, [mapped(matrix, np.array(item.points))]) for item in items]
        if scene not in pictures:
            return {"found": []}
        back = np.linalg.inv(matrices[scene])
        found = suggest(pictures, told, scene)
        return {"found": [{"kind": kind, "points": np.round(mapped(back, ring), 1).tolist()} for kind, ring in found]}

    @as_sent
    def place_table(self, scene: str, everywhere: bool, corners: Corners | None, size_m: Point) -> None:
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
            values: dict[str, Any] = {"size_m": size_m}
            if isinstance(placed, dict):
                values["corners"] = {name: places.round(1).tolist() for name, places in placed.items()}
            else:
                values |= {"rectified": True} if placed is None else {"corners": placed.round(1).tolist()}
            files.check_settings(values)
            text = HEADER + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, default_flow_style=None)
            before = (self.folder / SETTINGS).read_text(encoding="utf-8") if (self.folder / SETTINGS).is_file() else ""
            write_durably(self.folder / SETTINGS, files.with_import(text, before))

    def recorded(self) -> list[pd.DataFrame]:
        """Return the rows of each path (the same scene, user and demo) in their order."""
        return [rows for _, rows in self._table()[COLUMNS].groupby(KEY, sort=False)]

    def _path(self, id: str) -> pd.DataFrame:
        """Return the rows of a path as the page saw it; raise InputError if it is not there."""
        rows = next((rows for rows in self.recorded() if identity(rows) == id), None)
        if rows is None:
            raise InputError("this path has been judged or removed already")
        return rows

    def _scenes(self) -> dict[str, Path]:
        scenes = files.scene_files(self.folder, faults := Faults())
        if faults:
            raise InputError(faults[0])
        return {scene: self._inside(path) for scene, path in scenes.items()}

    def _settings(self) -> Settings:
        return files.read_settings(self._inside(self.folder / SETTINGS).parent)

    def _table(self) -> pd.DataFrame:
        """Return demonstrations.csv as text, empty if there is none; InputError for its first fault."""

        def read(path: Path) -> pd.DataFrame:
            if files.read_checked(path, None, faults := Faults()) is None or faults:
                raise InputError(faults[0])
            return files.read_csv(path, COLUMNS)

        path = self._inside(self.folder / DEMONSTRATIONS)
        return self._read(path, read) if path.exists() else pd.DataFrame(columns=COLUMNS, dtype=str)

    def _coco(self) -> tuple[dict[str, Any], dict[str, list[Item]]]:
        """Return the content of items.json, and its items by scene; InputError if it is no COCO file."""
        path = self._inside(self.folder / COCO)
        try:
            text = path.read_text(encoding="utf-8-sig") if path.exists() else '{"images": [], "annotations": []}'
            content = json.loads(text)
            return content, from_coco(content)
        except (ValueError, KeyError, TypeError, InputError) as error:
            raise InputError(f"{COCO} cannot be read ({error!r}): move it away, or correct it") from error

    def _read(self, path: Path, read: Callable[[Path], Any]) -> Any:
        """Return what `read` makes of a file, which it reads again only after a change."""
        stat = path.stat()
        state = stat.st_ino, stat.st_size, stat.st_mtime_ns
        if path not in self._known or self._known[path][0] != state:
            self._known[path] = state, read(path)
        return self._known[path][1]

    def _write_paths(self, *parts: pd.DataFrame) -> None:
        table = pd.concat(parts, ignore_index=True).fillna("")
        write_durably(self.folder / DEMONSTRATIONS, table.to_csv(index=False, lineterminator="\n"))

    def _inside(self, path: Path) -> Path:
        """Return `path`; raise InputError if it leads out of the folder, as a symbolic link can."""
        if not path.resolve().is_relative_to(self.folder.resolve()):
            raise InputError(f"{path.relative_to(self.folder)} is a link out of the folder: replace it by the file")
        return path

    def _corners(self, scene: str, settings: Settings) -> Float[Array, "4 2"] | None:
        """Return the corners [px] of the table in a scene's picture, or None if they are not known."""
        size, corners = self.picture_size(scene), settings.corners_of(scene)
        fits = settings.rectified and files.has_shape(*size, settings.size_m)
        return whole(*size) if corners is None and fits else corners


def write_durably(path: Path, text: str) -> None:
    """Replace a file atomically, and return only once it would survive a power cut."""
    atomic_write(path, lambda part: (part.write_text(text, encoding="utf-8"), _sync(part)))
    _sync(path.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def tidy_name(name: str) -> str:
    """Return a name without needless spaces; raise InputError for one that a csv file should not hold."""
    name = normal(name)
    if not 1 <= len(name) <= MAX_NAME or name.startswith(tuple("=+-@")) or not is_printable(name):
        expected = f"1 to {MAX_NAME} printable characters, and at the front no =, +, - or @, which a spreadsheet runs"
        raise InputError(f"the name is {name[:MAX_NAME]!r}: expected {expected}")
    return name


def described(rows: pd.DataFrame) -> dict[str, Any]:
    """Return what the page shows of a path."""
    user, demo, word = rows[["user", "demo", "valid"]].iloc[0]
    return {"id": identity(rows), "user": user, "demo": demo, "valid": word.lower() == "true" if word else None}


def identity(rows: pd.DataFrame) -> str:
    """Return a name that changes with the content of these rows, so that nobody removes what they have not seen."""
    return hashlib.sha256(repr(rows.to_numpy().tolist()).encode()).hexdigest()[:16]
