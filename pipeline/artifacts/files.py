"""Read and write tables, JSON and arrays: atomically, and with the same bytes for the same contents."""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.runtime.errors import InputError
from pipeline.runtime.reading import read_csv
from pipeline.runtime.writing import atomic_write

# columns of csv files that hold names, some of which people choose
NAMES = (
    *("user", "other", "first", "second", "variant", "learner", "against", "source", "question", "family"),
    *("symbol", "added", "change", "split", "note", "who"),
)


def _need_file(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{path} is missing: run `make repro` (or the stage that writes it) first")


def data_version(folder: str) -> str:
    """Return the md5 of the data in `folder`, as DVC's file beside it names it; raise InputError if none does."""
    path = Path(f"{folder}.dvc")
    digest = re.search(r"md5: (\w+)", path.read_text(encoding="utf-8")) if path.is_file() else None
    if digest is None:
        raise InputError(f"{path} names no md5 of the data: get it with `git checkout {path}`")
    return digest[1]


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write a data frame as parquet (`.parquet`) or as csv (`.csv`, 6 significant digits)."""
    if path.suffix == ".csv":
        atomic_write(path, lambda p: table.to_csv(p, index=False, float_format="%.6g", lineterminator="\n"))
    else:
        atomic_write(path, lambda p: table.to_parquet(p, index=False, compression="zstd"))


def read_table(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Return a table written by `write_table`; InputError if it is missing, unreadable or lacks a column."""
    _need_file(path)
    try:
        table = read_csv(path, NAMES) if path.suffix == ".csv" else pd.read_parquet(path)
    except Exception as error:
        raise InputError(f"{path} cannot be read ({error}): delete it and run its stage again") from error
    missing = [c for c in columns or () if c not in table.columns]
    if missing:
        raise InputError(f"{path} has columns {list(table.columns)}: expected also {missing}; run its stage again")
    return table if columns is None else table[list(columns)]


def write_json(path: Path, content: Mapping) -> None:
    """Write JSON with sorted keys; raise ValueError for NaN and infinity."""
    text = json.dumps(content, indent=2, sort_keys=True, allow_nan=False) + "\n"
    atomic_write(path, lambda p: p.write_text(text, encoding="utf-8"))


def read_json(path: Path) -> dict:
    """Return a JSON object; InputError if the file is missing or invalid."""
    _need_file(path)
    try:
        content = json.loads(path.read_bytes())
    except ValueError as error:  # json's own, and UnicodeDecodeError
        raise InputError(f"{path} is no JSON ({error}): run its stage again") from error
    if not isinstance(content, dict):
        raise InputError(f"{path} holds a {type(content).__name__}: expected an object; run its stage again")
    return content


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write named arrays as an uncompressed npz, in the given order."""

    def write(temporary: Path) -> None:
        with temporary.open("wb") as file:
            np.savez(file, allow_pickle=False, **arrays)  # pyright: ignore[reportArgumentType]

    atomic_write(path, write)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Return all arrays of an npz by name; InputError if it is missing or truncated."""
    _need_file(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            return {name: file[name] for name in file.files}
    except Exception as error:
        raise InputError(f"{path} cannot be read ({error}): delete it and run its stage again") from error
