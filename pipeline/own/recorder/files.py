"""The files of a person's folder: read as the report reads them, replaced atomically and durably."""

import os
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import pandas as pd

from pipeline.own.csv_files import COLUMNS, Faults, read_csv
from pipeline.own.pictures import read_picture, scene_files
from pipeline.own.settings import SETTINGS, Settings, read_settings
from pipeline.runtime.errors import InputError
from pipeline.runtime.writing import atomic_write

State = tuple[int, ...]  # what changes when a file is replaced or edited


def list_scenes(folder: Path) -> dict[str, Path]:
    """Return the picture of each scene, in the order of names; InputError for two of one name or a link outwards."""
    faults = Faults()
    scenes = scene_files(folder, faults)
    if scenes and faults:
        raise InputError(faults[0])
    return {scene: inside(folder, path) for scene, path in scenes.items()}


def read_place(folder: Path) -> Settings:
    """Return where the table, start and goal are, from table.yaml; InputError if it makes no sense."""
    inside(folder, folder / SETTINGS)
    return read_settings(folder)


def read_table(folder: Path, name: str) -> pd.DataFrame:
    """Return a csv file as text, empty if there is none; InputError if it cannot be read. Nobody may change it."""
    path = inside(folder, folder / name)
    return _read_table(path, _state(path))


@lru_cache(maxsize=4)
def _read_table(path: Path, state: State) -> pd.DataFrame:
    return read_csv(path, COLUMNS[path.name]) if state else pd.DataFrame(columns=COLUMNS[path.name], dtype=str)


def picture_size(path: Path) -> tuple[int, int]:
    """Return width and height [px] of a picture, upright; InputError if it cannot be read."""
    return _picture_size(path, _state(path))


@lru_cache(maxsize=1000)
def _picture_size(path: Path, state: State) -> tuple[int, int]:
    try:
        height, width = read_picture(path).shape[:2]
    except InputError as error:
        raise InputError(f"{path.parent.name}/{path.name} {error}") from error
    return width, height


def _state(path: Path) -> State:
    if not path.exists():
        return ()
    stat = path.stat()
    return stat.st_ino, stat.st_size, stat.st_mtime_ns


def inside(folder: Path, path: Path) -> Path:
    """Return `path`; raise InputError if it leads out of the folder, as a symbolic link can."""
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"{path.relative_to(folder)} is a link out of the folder: replace it by the file itself")
    return path


def write_durably(folder: Path, name: str, write: Callable[[Path], object]) -> None:
    """Replace a file atomically, and return only once it would survive a power cut."""
    path = inside(folder, folder / name)

    def write_and_sync(part: Path) -> None:
        write(part)
        _sync(part)

    atomic_write(path, write_and_sync)
    _sync(path.parent)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
