"""Store what is recorded in a folder: every change reads, checks and replaces one file, one change at a time."""

import hashlib
import math
import re
from pathlib import Path
from threading import RLock
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
import yaml
from jaxtyping import Float
from numpy import ndarray as Array
from pydantic import ConfigDict, Field, FiniteFloat, validate_call

from pipeline.own.csv_files import COLUMNS, DEMONSTRATIONS, ITEMS, KEY, normal
from pipeline.own.demonstrations import ENDS_WITHIN_M, MIN_SAMPLES, MIN_SCENES
from pipeline.own.frame import outline
from pipeline.own.pictures import KINDS, SCENES, is_square, read_picture
from pipeline.own.recorder import files
from pipeline.own.recorder.geometry import View
from pipeline.own.settings import SETTINGS, Settings, check_settings
from pipeline.runtime.errors import InputError
from pipeline.world.hand import MAX_BEYOND_M
from pipeline.world.images import PNG_SIGNATURE

HEADER = "# Where the table is in the pictures, written by the recorder. docs/own-tables.md says what each line is.\n"
MIN_STEP_S = 0.008  # between stored samples; some pens report 240 a second
MIN_RADIUS_M = 0.002  # of an item
MAX_NAME = 60  # characters of a person's or a kind's name
FORMULA = "=+-@"  # a spreadsheet runs a cell that begins so
FIELDS = 10  # of the grid over the table, a side

Point = Annotated[list[FiniteFloat], Field(min_length=2, max_length=2)]
Points = Annotated[list[Point], Field(min_length=2, max_length=3)]
Corners = Annotated[list[Point], Field(min_length=4, max_length=4)]
Sample = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3)]
Samples = Annotated[list[Sample], Field(min_length=1, max_length=100_000)]
as_sent = validate_call(config=ConfigDict(strict=True))  # checks what a page sends as the arguments of a method


class Recordings:
    """The scenes, paths, items and the table of one folder. Its methods may be called from several threads."""

    def __init__(self, folder: Path) -> None:
        """Open a folder; raise InputError if what it holds cannot be read."""
        self.folder = folder
        self._lock = RLock()
        self.overview()

    def overview(self) -> dict[str, Any]:
        """Return scenes, users, kinds, the number of paths and items, and start and goal."""
        with self._lock:
            scenes, settings = files.list_scenes(self.folder), files.read_place(self.folder)
            paths, items = self._table(DEMONSTRATIONS).drop_duplicates(KEY), self._table(ITEMS)
            counts: dict[str, dict[str, dict[str, int]]] = {scene: {} for scene in scenes}
            for scene, user, word in zip(paths["scene"], paths["user"], paths["valid"], strict=True):
                count = counts.setdefault(scene, {}).setdefault(user, {"valid": 0, "invalid": 0})
                count["valid" if _is_true(word) else "invalid"] += 1
            kinds = {normal(path.name) for path in self.folder.glob(f"{KINDS}/*/")}
            return {
                "folder": self.folder.resolve().name,
                "scenes": list(scenes),
                "users": list(dict.fromkeys(paths["user"])),
                "counts": counts,
                "items": items["scene"].value_counts().reindex(list(scenes), fill_value=0).to_dict(),
                "kinds": sorted(kinds | set(items["kind"])),
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
            settings = files.read_place(self.folder)
            corners = self._corners(name, settings)
            if corners is None:
                return {"name": name, "corners": None, "paths": [], "items": []}
            view, side = View.of(corners, settings.side_m), settings.side_m
            ends = {"start": settings.start, "goal": settings.goal}
            upright = [np.array([[x, 0], [x, side]]) for x in np.linspace(0, side, FIELDS + 1)[1:-1]]
            return {
                "name": name,
                "corners": corners.tolist(),
                "matrix": view.matrix.tolist(),
                "grid": [view.pixels(line) for line in [*upright, *(line[:, ::-1] for line in upright)]],
                "ends": {end: view.pixels(place[None])[0] for end, place in ends.items()},
                "zones": {
                    end: view.pixels(outline(np.stack([place, place]), ENDS_WITHIN_M)) for end, place in ends.items()
                },
                "paths": [
                    _described(rows) | {"points": view.pixels(_numbers(rows, ["x", "y"]))}
                    for (scene, *_), rows in self.recorded(DEMONSTRATIONS).items()
                    if scene == name
                ],
                "items": [
                    {"id": _identity(rows), "kind": kind, "outline": view.pixels(_outline(rows))}
                    for (scene, kind, *_), rows in self.recorded(ITEMS).items()
                    if scene == name
                ],
            }

    def picture(self, scene: str) -> Path:
        """Return the file of a scene's picture; raise InputError if there is none."""
        scenes = files.list_scenes(self.folder)
        if scene not in scenes:
            raise InputError(f"there is no picture of scene {scene!r}: reload the page")
        return scenes[scene]

    @as_sent
    def add_path(self, scene: str, user: str, valid: bool, samples: Samples) -> dict[str, Any]:
        """Store a path and return its demo, id and label; a path that is stored already is not stored twice.

        samples: t [ms], column and row [px]. Raise InputError if they do not lead from start to goal.
        """
        user = tidy_name("person’s name", user)
        with self._lock:
            view, settings = self._view(scene)
            kept = _thinned(np.array(samples))
            if len(kept) < MIN_SAMPLES:
                raise InputError(
                    f"not stored: the path has {len(kept)} samples, expected {MIN_SAMPLES}; draw it slower"
                )
            metres = view.metres(kept[:, 1:])
            for verb, end, point in (("begins", "start", metres[0]), ("ends", "goal", metres[-1])):
                if (distance := math.dist(getattr(settings, end), point)) > ENDS_WITHIN_M:
                    raise InputError(
                        f"not stored: the path {verb} {100 * distance:.0f} cm from the {end}, expected at most "
                        f"{100 * ENDS_WITHIN_M:.0f} cm; draw it again"
                    )
            if np.maximum(-metres, metres - settings.side_m).max() > MAX_BEYOND_M * settings.side_m:
                raise InputError("not stored: the path goes far off the table; draw it again")
            stored = {key[2]: path for key, path in self.recorded(DEMONSTRATIONS).items() if key[:2] == (scene, user)}
            demo = str(max((int(demo) for demo in stored if demo.isdecimal()), default=0) + 1)
            rows = pd.DataFrame(
                [
                    (scene, user, demo, f"{t:.3f}", f"{x:.4f}", f"{y:.4f}", "true" if valid else "false")
                    for t, (x, y) in zip((kept[:, 0] - kept[0, 0]) / 1000, metres, strict=True)
                ],
                columns=COLUMNS[DEMONSTRATIONS],
            )
            for path in stored.values():  # the page sends it again if the first answer got lost
                if path.assign(demo=demo).to_numpy().tolist() == rows.to_numpy().tolist():
                    return _described(path)
            self._append(DEMONSTRATIONS, rows)
            return _described(rows)

    @as_sent
    def add_item(self, scene: str, kind: str, points: Points) -> None:
        """Store an item's footprint; one that is stored already is not stored twice.

        points: centre and rim [px], or both ends and a place on the side. Raise InputError if they outline no item.
        """
        kind = tidy_name("kind", kind)
        with self._lock:
            view, settings = self._view(scene)
            metres = view.metres(np.array(points))
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
                self._append(ITEMS, pd.DataFrame([row], columns=COLUMNS[ITEMS]))

    @as_sent
    def remove(self, what: Literal["path", "item"], id: str) -> None:
        """Remove a path or an item; raise InputError if it is not there as the page saw it."""
        name = DEMONSTRATIONS if what == "path" else ITEMS
        with self._lock:
            rows = next((rows for rows in self.recorded(name).values() if _identity(rows) == id), None)
            if rows is None:
                raise InputError(f"this {what} has been removed already")
            self._write(name, self._table(name).drop(rows.index))

    @as_sent
    def place_table(
        self, scene: str, everywhere: bool, corners: Corners | None, side_m: FiniteFloat, start: Point, goal: Point
    ) -> None:
        """Write table.yaml; corners [px] hold in `scene` or `everywhere`, and None leaves them as they are."""
        with self._lock:
            settings, size = files.read_place(self.folder), files.picture_size(self.picture(scene))
            placed = settings.corners
            if corners is not None:
                marked = np.array(corners)
                if ((marked < 0) | (marked > size)).any():
                    raise InputError("a corner lies outside the picture: mark it again")
                if placed is not None and not isinstance(placed, dict):
                    placed = dict.fromkeys(files.list_scenes(self.folder), placed)
                placed = marked if everywhere else {**(placed or {}), scene: marked}
            values: dict[str, Any] = {"side_m": side_m}
            if isinstance(placed, dict):
                values["corners"] = {name: places.round(1).tolist() for name, places in placed.items()}
            elif placed is not None:
                values["corners"] = placed.round(1).tolist()
            else:
                values["rectified"] = True
            values |= {"start": start, "goal": goal}
            check_settings(values)
            text = HEADER + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, default_flow_style=None)
            files.write_durably(self.folder, SETTINGS, lambda part: part.write_text(text, encoding="utf-8"))

    def import_picture(self, file_name: str, content: bytes) -> str:
        """Store a JPEG or PNG as a new scene and return its name, made from the file's.

        Raise InputError if the content is no such picture, is too large or damaged, or the name is taken.
        """
        scene = re.sub(r"[^\w.-]+", "_", Path(normal(file_name).replace("\\", "/")).stem).strip("._-")[:80]
        if not scene:
            raise InputError(f"the file name {file_name!r} has no letter or digit: rename the file")

        def write(part: Path) -> None:
            part.write_bytes(content)
            try:
                read_picture(part)
            except InputError as error:
                raise InputError(f"{file_name} {error}") from error

        ending = ".png" if content.startswith(PNG_SIGNATURE) else ".jpg"
        with self._lock:
            if scene in files.list_scenes(self.folder):
                raise InputError(f"there is a scene {scene} already: rename the file, or remove the earlier picture")
            files.write_durably(self.folder, f"{SCENES}/{scene}{ending}", write)
        return scene

    def _table(self, name: str) -> pd.DataFrame:
        return files.read_table(self.folder, name)

    def _write(self, name: str, table: pd.DataFrame) -> None:
        files.write_durably(self.folder, name, lambda part: table.to_csv(part, index=False, lineterminator="\n"))

    def _append(self, name: str, rows: pd.DataFrame) -> None:
        self._write(name, pd.concat([self._table(name), rows], ignore_index=True).fillna(""))

    def recorded(self, name: str) -> dict[tuple[str, ...], pd.DataFrame]:
        """Return the rows of each path by scene, user and demo, or of each item by all its columns, in their order."""
        columns = COLUMNS[name]
        return dict(iter(self._table(name)[columns].groupby(KEY if name == DEMONSTRATIONS else columns, sort=False)))

    def _corners(self, scene: str, settings: Settings) -> Float[Array, "4 2"] | None:
        """Return the corners [px] of the table in a scene's picture, or None if they are not known."""
        width, height = files.picture_size(self.picture(scene))
        corners = settings.corners_of(scene)
        if corners is None and settings.rectified and is_square(width, height):
            return np.array([[0, 0], [width, 0], [width, height], [0, height]], float)
        return corners

    def _view(self, scene: str) -> tuple[View, Settings]:
        settings = files.read_place(self.folder)
        corners = self._corners(scene, settings)
        if corners is None:
            raise InputError(f"the table's corners in scene {scene} are not known: mark them first")
        return View.of(corners, settings.side_m), settings


def tidy_name(what: str, name: str) -> str:
    """Return a name without needless spaces; raise InputError for one that a csv file should not hold."""
    name = " ".join(normal(name).split())
    if not 1 <= len(name) <= MAX_NAME:
        raise InputError(f"the {what} has {len(name)} characters: expected 1 to {MAX_NAME}")
    if name[0] in FORMULA or not name.isprintable():
        raise InputError(f"the {what} {name!r} would be a formula in a spreadsheet, or cannot be printed: change it")
    return name


def _described(rows: pd.DataFrame) -> dict[str, Any]:
    first = rows.iloc[0]
    return {"id": _identity(rows), "user": first["user"], "demo": first["demo"], "valid": _is_true(first["valid"])}


def _identity(rows: pd.DataFrame) -> str:
    """Return a name that changes with the content of these rows, so that nobody removes what they have not seen."""
    return hashlib.sha256(repr(rows.to_numpy().tolist()).encode()).hexdigest()[:16]


def _outline(rows: pd.DataFrame) -> Float[Array, "n 2"]:
    """Return the outline [m] of an item."""
    x, y, angle, radius, half = _numbers(rows, COLUMNS[ITEMS][2:])[0]
    along = half * np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    return outline(np.array([x, y]) + np.stack([-along, along]), radius)


def _numbers(rows: pd.DataFrame, columns: list[str]) -> Float[Array, "row column"]:
    try:
        return rows[columns].to_numpy(float)
    except ValueError as error:
        scene = rows["scene"].iloc[0]
        raise InputError(f"scene {scene}: a csv file holds no number where one is needed ({error})") from error


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
