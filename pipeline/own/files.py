"""Read the files that people write: csv row by row, table.yaml; sentences name what is wrong."""

import csv
import re
import unicodedata
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import pandas as pd
import yaml
from numpy import ndarray as Array
from pydantic import Field, FiniteFloat, TypeAdapter, ValidationError

from pipeline.runtime.errors import InputError

DEMONSTRATIONS, ITEMS, CUTOUTS, SETTINGS = "demonstrations.csv", "items.csv", "kinds.csv", "table.yaml"
SCENES, KINDS = "scenes", "kinds"  # folders with the pictures of tables, and with a folder of cut-outs for each kind
COLUMNS = {
    DEMONSTRATIONS: ["scene", "user", "demo", "t", "x", "y", "valid"],
    ITEMS: ["scene", "kind", "x", "y", "angle_deg", "radius_m", "half_length_m"],
    CUTOUTS: ["kind", "file", "width_m"],
}
KEY = ["scene", "user", "demo"]  # of a demonstration
WORDS = {*KEY, "kind", "file", "valid"}  # columns that hold names, or a word; the others hold numbers

UNSEEN = "\u00ad\u200b\u2060\ufeff"  # hyphens and spaces that no page shows; joiners of emoji and Persian stay
ENDINGS = (".jpg", ".jpeg", ".png")
UNREAD = (  # of pictures that are not read
    *(".arw", ".avif", ".bmp", ".cr2", ".cr3", ".dng", ".gif", ".heic", ".heif", ".jfif", ".jp2", ".jxl"),
    *(".nef", ".tif", ".tiff", ".webp"),
)
SHAPE_WITHIN = 0.02  # a picture of just the table has the table's shape within this share

KNOWN = ("size_m", "corners", "rectified", "import")
IMPORT = re.compile(r"^import *:.*\n?(?:(?:[ #].*)?\n|[ #].*)*", re.MULTILINE)
MIN_TABLE_PX = 50  # shortest side of the table in a picture
SIDES_M = (0.1, 10.0)  # side of a table [m]
ORDER = "far left, far right, near right, near left"
Pair = tuple[FiniteFloat, FiniteFloat]
Side = Annotated[FiniteFloat, Field(ge=SIDES_M[0], le=SIDES_M[1])]
SIZE, CORNERS = TypeAdapter(Side | tuple[Side, Side]), TypeAdapter(tuple[Pair, Pair, Pair, Pair])


class Faults(list[str]):
    """Sentences that each name a file, what came, what was expected and what to do; and notes, which are no faults."""

    def __init__(self) -> None:
        super().__init__()
        self.notes: list[str] = []

    def rows(self, file: str, wrong: pd.DataFrame, sentence: str) -> None:
        """Add a sentence for the first of these wrong rows, and the number of rows like it.

        wrong: numbered as in the file, as by `read_csv`; sentence: its fields are columns of `wrong`.
        """
        if len(wrong):
            more = f" ({len(wrong) - 1} more like it)" if len(wrong) > 1 else ""
            self.append(f"{file}, row {wrong.index[0]}: {sentence.format(**wrong.iloc[0])}{more}")


def normal(name: str) -> str:
    """Return a name with single, plain spaces, composed accents and none of UNSEEN: names that look alike are one."""
    with suppress(UnicodeEncodeError):  # names of files are UTF-8 whatever the locale
        name = name.encode("utf-8", "surrogateescape").decode("utf-8", "surrogateescape")
    return " ".join(unicodedata.normalize("NFC", name.translate(dict.fromkeys(map(ord, UNSEEN)))).split())


def is_printable(name: str) -> bool:
    """Return whether a name has no control characters; joiners (Persian, emoji) and marks of direction are none."""
    joining = {c for c in name if unicodedata.category(c) == "Cf" and unicodedata.bidirectional(c) in ("BN", "L", "R")}
    return "".join(c for c in name if c not in joining).isprintable()


def read_csv(path: Path, columns: Sequence[str]) -> pd.DataFrame:
    """Return a csv as text, names normalised, rows numbered as in the file.

    Semicolons or tabs may separate the columns; numbers may then have decimal commas, which become points. Raise
    InputError unless it is UTF-8 with these columns.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
        separators = ",;\t"
        if told := re.match(r'"?sep=(.)"?\1*\r?\n', text, re.IGNORECASE):  # a line for Excel alone
            text, separators = text[told.end() :], separators + told[1]
        separator = max(separators, key=text.partition("\n")[0].count)
        header, *rows = list(csv.reader(StringIO(text), delimiter=separator, strict=True)) or [[]]
        while header and not any(row[len(header) - 1 :][:1] > [""] for row in [header, *rows]):
            header, rows = header[:-1], [row[: len(header) - 1] + row[len(header) :] for row in rows]  # empty columns
    except UnicodeDecodeError as error:
        raise InputError(f"{path.name} is not UTF-8: save it as “CSV UTF-8”") from error
    except csv.Error as error:
        raise InputError(f"{path.name} cannot be read as csv ({error}): save it anew") from error
    header = [normal(column).lower() for column in header]
    if not any(header):
        raise InputError(f"{path.name} is empty: expected a header line with {', '.join(columns)}")
    if missing := [column for column in columns if column not in header]:
        raise InputError(f"{path.name} has the columns {', '.join(header)}: expected also {', '.join(missing)}")
    if twice := [column for column in header if header.count(column) > 1]:
        raise InputError(f"{path.name} has two columns {twice[0]!r}: remove one")
    numbered = {number: row for number, row in enumerate(rows, 2) if any(row)}  # as a spreadsheet counts
    for number, row in numbered.items():
        if len(row) != len(header):
            counted = f"has {len(row)} cells, the header {len(header)}"
            raise InputError(f"{path.name}, row {number}: {counted}: correct it; texts with commas need quotes")
    table = pd.DataFrame(list(numbered.values()), index=list(numbered), columns=header, dtype=str).map(normal)
    if separator != ",":
        numbers = [column for column in columns if column not in WORDS]
        table[numbers] = table[numbers].replace(r"^([^.,]*),([^.,]*)$", r"\1.\2", regex=True)
    return table


def read_checked(path: Path, scenes: Collection[str] | None, faults: Faults) -> pd.DataFrame | None:
    """Return the COLUMNS of a file of this name, numbers as such, or None if it cannot be read.

    Add a fault for names that cannot be printed, scenes other than `scenes` if there are any, words other than true,
    false and none, and cells that hold no number: they become NaN.
    """
    file, columns = path.name, COLUMNS[path.name]
    try:
        text = read_csv(path, columns)[columns]
    except InputError as error:
        faults.append(str(error))
        return None
    if scenes is not None:
        unknown = text[~text["scene"].isin(list(scenes))]
        faults.rows(file, unknown, "scene {scene!r} has no picture in scenes/: add it, or correct the name")
    table = text.copy()
    for column, cells in text.items():
        if column == "valid":
            right = cells.str.lower().isin(["true", "false", ""])
            expected = "true, false, or nothing where nobody judged"
        elif column in WORDS:
            printable = cells.map(lambda name: bool(name) and is_printable(name))
            right, expected = printable.astype(bool), "a name of letters, digits and signs"
        else:
            numbers = pd.to_numeric(cells, errors="coerce").astype(float)
            right, expected = np.isfinite(numbers), "a number with a decimal point, and no other separator"
            table[column] = numbers.where(right)
        faults.rows(file, text[~right], f"{column} is {{{column}!r}}: expected {expected}")
    return table


def listed(folder: Path, *endings: str) -> list[Path]:
    """Return the files in a folder with one of these endings; hidden ones belong to the system, such as `._a.png`."""
    return [file for file in sorted(folder.glob("[!.]*")) if file.suffix.lower() in endings]


def scene_files(path: Path, faults: Faults) -> dict[str, Path]:
    """Return the picture of each scene in a folder by name, in the order of the names."""
    if not (path / SCENES).is_dir():
        faults.append(f"{SCENES}/ is missing: expected a folder with a picture of each scene")
        return {}
    endings = ", ".join(ENDINGS)
    for file in listed(path / SCENES, *UNREAD):
        faults.append(f"{SCENES}/{file.name} is not read: expected a name that ends in {endings}; convert it")
    scenes: dict[str, Path] = {}
    for file in listed(path / SCENES, *ENDINGS):
        name = normal(file.stem)
        if not is_printable(name):
            faults.append(f"{SCENES}/{file.name!r} has characters that cannot be printed: rename it")
        elif name in scenes:
            faults.append(f"{SCENES}/{file.name} and {scenes[name].name} are one scene {name!r}: rename one of them")
        else:
            scenes[name] = file
    if not scenes:
        faults.append(f"{SCENES}/ holds no picture: expected files that end in {endings}")
    return scenes


def has_shape(width: int, height: int, size_m: Array) -> bool:
    """Return whether a picture may show just a table of this width and depth [m]."""
    across, along = width * size_m[1], height * size_m[0]
    return bool(abs(across - along) <= SHAPE_WITHIN * max(across, along))


@dataclass
class Settings:
    """Hold what table.yaml says."""

    size_m: Array  # (2,), width and depth of the table
    corners: Array | dict[str, Array] | None  # (4, 2) [px], of all scenes or by scene
    rectified: bool  # pictures show just the table

    def corners_of(self, scene: str) -> Array | None:
        """Return the corners (4, 2) [column, row] of the table in a scene's picture; None: the whole picture."""
        return self.corners.get(scene) if isinstance(self.corners, dict) else self.corners


def read_settings(path: Path) -> Settings:
    """Return the settings of table.yaml, or the defaults; raise InputError with a line for each fault."""
    return check_settings(read_content(path))


def read_content(path: Path) -> dict[str, Any]:
    """Return what a folder's table.yaml holds, all values as texts, {} if there is none; InputError if it cannot be."""
    if not (path / SETTINGS).is_file():
        return {}
    try:
        content = yaml.load((path / SETTINGS).read_text(encoding="utf-8"), yaml.BaseLoader)  # 01 is a scene's name
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{SETTINGS} cannot be read: {' '.join(str(error).split())}; correct it") from error
    if not isinstance(content or {}, dict) or set(content or {}) - set(KNOWN):
        names = ", ".join(map(repr, content)) if isinstance(content, dict) else type(content).__name__
        raise InputError(f"{SETTINGS} holds {names}: expected some of {', '.join(KNOWN)}")
    return content or {}


def with_import(text: str, before: str) -> str:
    """Return a table.yaml with `import` of the one before: its lines, or its values where these have no own lines."""
    imported, lines = (yaml.safe_load(before) or {}).get("import"), IMPORT.search(before)
    if imported is None:
        return text
    with suppress(yaml.YAMLError):
        if lines and yaml.safe_load(text + lines[0])["import"] == imported:
            return text + lines[0]
    return text + yaml.safe_dump({"import": imported}, sort_keys=False, allow_unicode=True)


def check_settings(content: dict[str, Any]) -> Settings:
    """Return the content of table.yaml as settings; raise InputError with a line for each fault."""
    faults, corners = list[str](), content.get("corners")
    metres = f"one side or [width, depth] in metres, from {SIDES_M[0]} to {SIDES_M[1]:g}"
    size = _parsed(SIZE, content.get("size_m", 1.0), "size_m is", metres, faults)
    whole = content.get("rectified", "corners" not in content)
    rectified = _parsed(TypeAdapter(bool), whole, "rectified is", "true or false", faults)
    if isinstance(corners, dict):
        corners = {normal(scene): _corners(value, f"corners of {scene}", faults) for scene, value in corners.items()}
    elif corners is not None:
        corners = _corners(corners, "corners", faults)
    if corners is not None and rectified:
        faults.append("both corners and `rectified: true` are given, and they exclude each other: remove one of them")
    if faults or size is None:
        raise InputError("\n".join(f"{SETTINGS}: {fault}" for fault in faults))
    return Settings(np.broadcast_to(size, 2), corners, bool(rectified))


def _parsed(kind: TypeAdapter, value: Any, name: str, expected: str, faults: list[str]) -> Array | None:
    """Return the numbers that table.yaml holds, as text or as numbers, or None after a fault."""
    try:
        return np.array(kind.validate_python(value), float)
    except ValidationError:
        faults.append(f"{name} {value!r}: expected {expected}")
        return None


def _corners(value: Any, name: str, faults: list[str]) -> Array:
    """Return four corners; add a fault unless they bound a convex quadrilateral in the right order."""
    corners = _parsed(CORNERS, value, f"{name} are", f"four [column, row] in pixels, {ORDER}", faults)
    if corners is None:
        return np.zeros((4, 2))
    sides = np.roll(corners, -1, axis=0) - corners
    turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
    if (turns < 0).all():
        faults.append(f"{name} run counter-clockwise: expected {ORDER}")
    elif not (turns > 0).all():
        faults.append(f"{name} cross or lie on a line: expected a convex quadrilateral, {ORDER}")
    elif np.linalg.norm(sides, axis=1).min() < MIN_TABLE_PX:
        faults.append(f"{name} are less than {MIN_TABLE_PX} pixels apart: expected a larger table in the picture")
    return corners
