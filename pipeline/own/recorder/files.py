"""The files of a person's folder: read as the report reads them, replaced atomically and durably."""

import csv
import os
import re
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from pipeline.own.csv_files import Faults, normal, read_csv
from pipeline.own.pictures import SCENES, read_picture, scene_files
from pipeline.own.settings import SETTINGS, Settings, read_settings
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write
from pipeline.world.images import PNG_SIGNATURE

HEADER = "# Where the table is in the pictures, written by the recorder. docs/own-tables.md says what each line is.\n"
Row = dict[str, str]


@dataclass(frozen=True)
class Table:
    """The columns and rows of a csv file, every value as its text."""

    columns: list[str]
    rows: list[Row]


def read_table(path: Path, columns: Sequence[str]) -> Table:
    """Return a csv file, or an empty table of `columns` if there is none; InputError if it cannot be read."""
    if not path.exists():
        return Table(list(columns), [])
    table = read_csv(path, columns)
    return Table(list(table.columns), table.to_dict("records"))


def write_table(path: Path, table: Table) -> None:
    """Replace a csv file; rows that lack a column have an empty cell there."""

    def write(temporary: Path) -> None:
        with temporary.open("w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, table.columns, restval="", lineterminator="\n")
            writer.writeheader()
            writer.writerows(table.rows)

    write_durably(path, write)


def list_scenes(folder: Path) -> dict[str, Path]:
    """Return the picture of each scene, in the order of names; InputError for two of one name or a link outwards."""
    faults = Faults()
    scenes = scene_files(folder, faults) if (folder / SCENES).is_dir() else {}
    if scenes and faults:
        raise InputError(faults[0])
    return {scene: inside(folder, path) for scene, path in scenes.items()}


def import_picture(folder: Path, file_name: str, content: bytes) -> str:
    """Store a JPEG or PNG as a new scene and return its name, made from the file's.

    Raise InputError if the content is no such picture, is too large or damaged, or the name is taken.
    """
    scene = re.sub(r"[^\w.-]+", "_", Path(normal(file_name).replace("\\", "/")).stem).strip("._-")[:80]
    if not scene:
        raise InputError(f"the file name {file_name!r} has no letter or digit: rename the file")
    if scene in list_scenes(folder):
        raise InputError(f"there is a scene {scene} already: rename the file, or remove the earlier picture")

    def write(temporary: Path) -> None:
        temporary.write_bytes(content)
        try:
            read_picture(temporary)
        except InputError as error:
            raise InputError(f"{file_name} {error}") from error

    ending = ".png" if content.startswith(PNG_SIGNATURE) else ".jpg"
    write_durably(inside(folder, folder / SCENES / f"{scene}{ending}"), write)
    return scene


def read_table_place(folder: Path) -> Settings:
    """Return where the table, start and goal are, from table.yaml; InputError if it makes no sense."""
    inside(folder, folder / SETTINGS)
    faults = Faults()
    settings = read_settings(folder, faults)
    if settings is None:
        raise InputError(faults[0])
    return settings


def write_table_place(folder: Path, values: dict[str, Any]) -> None:
    """Replace table.yaml; InputError, and the file stays as it is, if the values make no sense."""
    text = HEADER + yaml.safe_dump(values, sort_keys=False, allow_unicode=True, default_flow_style=None)
    with tempfile.TemporaryDirectory() as trial:
        (Path(trial) / SETTINGS).write_text(text, encoding="utf-8")
        read_table_place(Path(trial))
    write_durably(inside(folder, folder / SETTINGS), lambda path: path.write_text(text, encoding="utf-8"))


def inside(folder: Path, path: Path) -> Path:
    """Return `path`; raise InputError if it leads out of the folder, as a symbolic link can."""
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{path.relative_to(folder)} is a link out of the folder: replace it by the file itself")
    return path


def write_durably(path: Path, write: Callable[[Path], object]) -> None:
    """Replace a file atomically, and return only once it would survive a power cut."""

    def write_and_sync(temporary: Path) -> None:
        write(temporary)
        _sync(temporary)

    atomic_write(path, write_and_sync)
    _sync(path.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
